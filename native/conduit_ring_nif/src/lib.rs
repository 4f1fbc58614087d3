//! The ring as the BEAM sees it: terms in, terms out. The protocol is `conduit_ring`'s.
//!
//! A publisher and a subscriber are resources. Each is released when the process that opened it dies; no callback of
//! theirs blocks or joins.

mod buffer;
mod demand;
mod exclusive;
mod hot;
mod lease;
mod publisher;
mod subscriber;
mod terms;

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

#[rustler::nif(schedule = "DirtyIo")]
fn topic_info<'a>(env: Env<'a>, topic: &str) -> NifResult<Term<'a>> {
    let info = conduit_ring::Topic::found(topic).and_then(|topic| conduit_ring::Info::read(&topic));
    Ok(match info {
        Ok(info) => terms::ok(env, InfoTerm::from(info)),
        Err(error) => failure(env, &error),
    })
}
