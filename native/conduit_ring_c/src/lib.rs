//! The ring for C: what stands behind `include/conduit_ring.h`, which is its documentation.
//!
//! No algorithm lives here. A function checks its pointers, calls [`conduit_ring`] and turns the answer into 0 or a
//! negative errno and a sentence. The types and constants below are the header's, field by field; `tests/abi.rs` holds
//! that they and all signatures are the same.
#![allow(non_camel_case_types, reason = "the names are those of the header")]

mod clock;
mod errno;
mod failure;
mod geometry;
mod info;
mod lease;
mod message;
mod pointer;
mod publisher;
mod subscriber;
mod version;
mod waker;

pub use geometry::{CONDUIT_RING_SLOT_HEADER_BYTES, conduit_ring_geometry};
pub use info::{
    CONDUIT_RING_READERS, CONDUIT_RING_STATE_CLOSED, CONDUIT_RING_STATE_DEAD,
    CONDUIT_RING_STATE_LEGACY, CONDUIT_RING_STATE_LIVE, CONDUIT_RING_STATE_RETIRED,
    CONDUIT_RING_STATE_UNKNOWN, conduit_ring_info, conduit_ring_reader,
};
pub use message::conduit_ring_meta;
pub use publisher::{
    CONDUIT_RING_FORCE, CONDUIT_RING_NO_THREAD, CONDUIT_RING_OWN_GROUP, conduit_ring_part,
    conduit_ring_publisher_options,
};
pub use subscriber::{
    CONDUIT_RING_EVENT_MESSAGE, CONDUIT_RING_EVENT_PUBLISHER_DOWN, CONDUIT_RING_EVENT_PUBLISHER_UP,
    CONDUIT_RING_FOREVER, CONDUIT_RING_GUARD_ALWAYS, CONDUIT_RING_GUARD_AUTO,
    CONDUIT_RING_GUARD_NEVER, CONDUIT_RING_POLICY_ALL, CONDUIT_RING_POLICY_LATEST,
    CONDUIT_RING_START_HISTORY, CONDUIT_RING_START_LATEST, CONDUIT_RING_START_NEW,
    conduit_ring_stats, conduit_ring_subscriber_options,
};
pub use version::CONDUIT_RING_ABI_VERSION;
