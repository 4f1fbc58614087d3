//! The C ABI of the ring: the implementation of `include/conduit_ring.h`, which is its
//! documentation.
//!
//! This crate has no algorithm. A function checks its pointers, calls [`conduit_ring`] and turns
//! the result into 0 or a negative errno and a message. The types and constants below are those
//! of the header, field by field; `tests/c_and_cpp/abi.rs` compares them and all signatures.
#![allow(non_camel_case_types, reason = "the names are those of the header")]

mod caller_buffer;
mod clock;
mod errno;
mod failure;
mod geometry;
mod info;
mod lease;
mod message;
mod pointer;
mod publication;
mod publisher;
mod publisher_options;
mod subscriber;
mod subscriber_options;
mod subscription;
mod version;
mod waker;

pub use geometry::{CONDUIT_RING_SLOT_HEADER_BYTES, conduit_ring_geometry};
pub use info::{
    CONDUIT_RING_READERS, CONDUIT_RING_STATE_CLOSED, CONDUIT_RING_STATE_DEAD,
    CONDUIT_RING_STATE_LEGACY, CONDUIT_RING_STATE_LIVE, CONDUIT_RING_STATE_RETIRED,
    CONDUIT_RING_STATE_UNKNOWN, conduit_ring_info, conduit_ring_reader,
};
pub use message::conduit_ring_meta;
pub use publisher::conduit_ring_part;
pub use publisher_options::{
    CONDUIT_RING_FORCE, CONDUIT_RING_NO_THREAD, CONDUIT_RING_OWN_GROUP,
    conduit_ring_publisher_options,
};
pub use subscriber::{CONDUIT_RING_FOREVER, conduit_ring_stats};
pub use subscriber_options::{
    CONDUIT_RING_GUARD_ALWAYS, CONDUIT_RING_GUARD_AUTO, CONDUIT_RING_GUARD_NEVER,
    CONDUIT_RING_POLICY_ALL, CONDUIT_RING_POLICY_LATEST, CONDUIT_RING_START_HISTORY,
    CONDUIT_RING_START_LATEST, CONDUIT_RING_START_NEW, conduit_ring_subscriber_options,
};
pub use subscription::{
    CONDUIT_RING_EVENT_MESSAGE, CONDUIT_RING_EVENT_PUBLISHER_DOWN,
    CONDUIT_RING_EVENT_PUBLISHER_UP,
};
pub use version::CONDUIT_RING_ABI_VERSION;
