//! The ring as the BEAM sees it: terms in, terms out. The protocol is `conduit_ring`'s.
//!
//! A publisher and a subscriber are resources. Each is released when the process that opened it dies; no callback of
//! theirs blocks or joins.

mod buffer;
mod demand;
mod exclusive;
mod hot;
mod lease;
mod names;
mod publisher;
mod subscriber;
mod terms;

use conduit_ring::trust::Trusted;
use rustler::{Env, NifResult, Term};

use crate::terms::{InfoTerm, failure};

rustler::init!("Elixir.BB.Ring.Native", load = load);

fn load(env: Env, _info: Term) -> bool {
    env.register::<publisher::PublisherResource>().is_ok()
        && env.register::<subscriber::SubscriberResource>().is_ok()
        && env.register::<lease::BinaryResource>().is_ok()
        && env.register::<lease::LeaseResource>().is_ok()
}

/// Nanoseconds of the ring's clock, CLOCK_MONOTONIC_RAW.
#[rustler::nif]
fn now_ns() -> u64 {
    conduit_ring::clock::now_ns()
}

/// The cost of a call alone: what publishing is measured against.
#[rustler::nif]
fn nothing() -> rustler::Atom {
    rustler::types::atom::ok()
}

/// The content tag of an encoding's name.
#[rustler::nif]
fn content_tag(name: &str) -> u64 {
    conduit_ring::ContentTag::of(name).value()
}

/// Trusts these users and groups, lists with commas between, beside those that the environment lists.
#[rustler::nif(schedule = "DirtyIo")]
fn trust<'a>(env: Env<'a>, users: &str, groups: &str) -> Term<'a> {
    let trusted = Trusted::of_environment().and_then(|mut trusted| {
        let configured = Trusted::parse(users, groups)?;
        trusted.users.extend(configured.users);
        trusted.groups.extend(configured.groups);
        Ok(trusted)
    });
    match trusted {
        Ok(trusted) => {
            trusted.apply();
            rustler::types::atom::ok().to_term(env)
        }
        Err(error) => terms::error(env, error.to_string()),
    }
}

#[rustler::nif(schedule = "DirtyIo")]
fn topic_info<'a>(env: Env<'a>, topic: &str) -> NifResult<Term<'a>> {
    let info = conduit_ring::Topic::found(topic).and_then(|topic| conduit_ring::Info::read(&topic));
    Ok(match info {
        Ok(info) => terms::ok(env, InfoTerm::from(info)),
        Err(error) => failure(env, &error),
    })
}
