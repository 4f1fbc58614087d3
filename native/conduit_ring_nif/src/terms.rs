//! The terms that represent messages, topics and errors in Elixir.

use std::path::Path;

use conduit_ring::{ContentTag, Error, Info, Meta, PublishError, Reader, State};
use rustler::{Atom, Binary, Encoder, Env, NifMap, NifStruct, Term};

use crate::buffer::Buffer;

/// The atoms of the terms.
pub mod atoms {
    rustler::atoms! {
        active, bb_ring, bb_ring_closed, bb_ring_passive, bb_ring_publisher, bb_ring_reply, busy,
        closed, dead, empty, foreign_owner, invalid, legacy, legacy_topic, live,
        message_too_large, name_lost, no_reader_slot, no_topic, not_a_ring, other_content,
        passive, publisher_alive, publisher_down, publisher_up, renewed, retired, slot_held,
        system, thread, timeout, too_many_leases, unknown,
    }
}

#[derive(NifStruct)]
#[module = "BB.Ring.Message"]
struct Message<'a> {
    sequence: u64,
    timestamp_ns: u64,
    data: Binary<'a>,
    lost: u64,
}

/// Encodes `{:ok, value}`.
pub fn ok<'a>(env: Env<'a>, value: impl Encoder) -> Term<'a> {
    (rustler::types::atom::ok(), value).encode(env)
}

/// Encodes `{:error, reason}`.
pub fn error<'a>(env: Env<'a>, reason: impl Encoder) -> Term<'a> {
    (rustler::types::atom::error(), reason).encode(env)
}

/// Encodes a message as a `%BB.Ring.Message{}`.
pub fn message(env: Env<'_>, meta: Meta, data: Buffer) -> Term<'_> {
    lent_message(env, meta, data.into_binary(env))
}

/// As [`message`], with a binary.
pub fn lent_message<'a>(env: Env<'a>, meta: Meta, data: Binary<'a>) -> Term<'a> {
    let message = Message {
        sequence: meta.sequence,
        timestamp_ns: meta.timestamp_ns,
        lost: meta.lost,
        data,
    };
    message.encode(env)
}

/// The state of a topic, as `t:BB.Ring.info/0`.
#[derive(NifMap)]
pub struct InfoTerm {
    topic: String,
    slot_count: u32,
    slot_size: u32,
    max_message_size: usize,
    published: u64,
    state: Atom,
    epoch: u32,
    writer_pid: u32,
    last_publish_ns: u64,
    readers: Vec<ReaderTerm>,
    rejected_oversize: u64,
    dropped_pinned: u64,
    wake_count: u64,
}

#[derive(NifMap)]
struct ReaderTerm {
    index: u32,
    os_pid: u32,
    native: bool,
    alive: bool,
    next_sequence: u64,
    lost: u64,
    leases: u32,
    held: Vec<u64>,
}

impl From<Info> for InfoTerm {
    fn from(info: Info) -> Self {
        Self {
            topic: info.topic.name().to_owned(),
            slot_count: info.geometry.slot_count(),
            slot_size: info.geometry.slot_size(),
            max_message_size: info.geometry.max_message_size(),
            published: info.published,
            state: state(info.state),
            epoch: info.epoch,
            writer_pid: info.writer_pid,
            last_publish_ns: info.last_publish_ns,
            readers: info.readers.into_iter().map(ReaderTerm::from).collect(),
            rejected_oversize: info.rejected_oversize,
            dropped_pinned: info.dropped_pinned,
            wake_count: info.wake_count,
        }
    }
}

impl From<Reader> for ReaderTerm {
    fn from(reader: Reader) -> Self {
        Self {
            index: reader.index,
            os_pid: reader.pid,
            native: reader.native,
            alive: reader.alive,
            next_sequence: reader.next_sequence,
            lost: reader.lost,
            leases: reader.leases,
            held: reader.held,
        }
    }
}

fn state(state: State) -> Atom {
    match state {
        State::Live => atoms::live(),
        State::Dead => atoms::dead(),
        State::Closed => atoms::closed(),
        State::Retired => atoms::retired(),
        State::Legacy => atoms::legacy(),
        _ => atoms::unknown(),
    }
}

/// Encodes `{:error, reason}` with a reason of `t:BB.Ring.reason/0`.
pub fn failure<'a>(env: Env<'a>, failed: &Error) -> Term<'a> {
    let reason = match failed {
        Error::ForeignOwner { path, user, name } => {
            (atoms::foreign_owner(), text(path), user, name).encode(env)
        }
        Error::PublisherAlive { pid, .. } => (atoms::publisher_alive(), pid).encode(env),
        Error::LegacyInUse { path } => (atoms::legacy_topic(), text(path)).encode(env),
        Error::NoReaderSlot { path } => (atoms::no_reader_slot(), text(path)).encode(env),
        Error::NoTopic { path } => (atoms::no_topic(), text(path)).encode(env),
        Error::BadSegment { path, fault } => {
            (atoms::not_a_ring(), text(path), fault.to_string()).encode(env)
        }
        Error::Os {
            action,
            path,
            source,
        } => (
            atoms::system(),
            text(path),
            *action,
            source.raw_os_error().unwrap_or(0),
        )
            .encode(env),
        other => (atoms::invalid(), other.to_string()).encode(env),
    };
    error(env, reason)
}

/// Encodes the error for a topic with unexpected content.
pub fn other_content(env: Env<'_>, found: ContentTag) -> Term<'_> {
    error(env, (atoms::other_content(), found.value()))
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

/// Returns the atom for a message that was not published.
pub fn publish_error(failed: &PublishError) -> Atom {
    match failed {
        PublishError::TooLarge { .. } => atoms::message_too_large(),
        PublishError::SlotHeld => atoms::slot_held(),
        PublishError::NameLost => atoms::name_lost(),
        _ => atoms::closed(),
    }
}
