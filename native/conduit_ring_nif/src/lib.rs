//! The ring for the BEAM: terms in, terms out. `conduit_ring` implements the protocol.
//!
//! Publishers and subscribers are resources. Each is released when the process that opened it
//! dies; none of their callbacks blocks or joins a thread.

mod buffer;
mod content;
mod demand;
mod exclusive;
mod lease;
mod name_watch;
mod publication;
mod publish_binary;
mod publisher;
mod reader;
mod sender;
mod subscriber;
mod subscription;
mod terms;

use conduit_ring::trust::Trusted;
use rustler::{Env, NifResult, Term};

use crate::terms::{InfoTerm, failure};

rustler::init!("Elixir.BB.Ring.Native", load = load);

fn load(env: Env, _info: Term) -> bool {
    env.register::<publication::PublisherResource>().is_ok()
        && env.register::<subscription::SubscriberResource>().is_ok()
        && env.register::<lease::BinaryResource>().is_ok()
        && env.register::<lease::LeaseResource>().is_ok()
}

/// Returns the time of the ring's clock, CLOCK_MONOTONIC_RAW, in nanoseconds.
#[rustler::nif]
fn now_ns() -> u64 {
    conduit_ring::clock::now_ns()
}

/// Does nothing. Benchmarks of publishing subtract the cost of this call.
#[rustler::nif]
fn nothing() -> rustler::Atom {
    rustler::types::atom::ok()
}

/// Returns the content tag of an encoding's name.
#[rustler::nif]
fn content_tag(name: &str) -> u64 {
    conduit_ring::ContentTag::of(name).value()
}

/// Trusts these users and groups, comma-separated lists, beside those of the environment.
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
    let info =
        conduit_ring::Topic::found(topic).and_then(|topic| conduit_ring::Info::read(&topic));
    Ok(match info {
        Ok(info) => terms::ok(env, InfoTerm::from(info)),
        Err(error) => failure(env, &error),
    })
}
