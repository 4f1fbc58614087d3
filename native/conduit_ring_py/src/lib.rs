//! The native half of the Python package `conduit_ring`. It converts Python's objects; the crate
//! `conduit_ring` implements the protocol.

mod bytes;
mod content;
mod errors;
mod fork;
mod info;
mod lease;
mod loan;
mod message;
mod publication;
mod publisher;
mod subscriber;
mod subscription;
mod timeout;

/// The module that `conduit_ring/__init__.py` imports.
#[pyo3::pymodule]
mod _native {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::{
        content::content_tag,
        fork::_after_fork,
        info::{info, topics},
        lease::Lease,
        loan::Loan,
        message::Message,
        publisher::Publisher,
        subscriber::{Events, Subscriber},
    };

    /// Return the time of the clock that stamps messages (CLOCK_MONOTONIC_RAW), in nanoseconds.
    ///
    /// The clock never steps and is the same for all processes of a machine: ``now_ns() -
    /// message.timestamp_ns`` is a message's age.
    #[pyfunction]
    fn now_ns() -> u64 {
        conduit_ring::clock::now_ns()
    }

    /// Return the current difference from :func:`now_ns` to wall time (nanoseconds since 1970).
    ///
    /// It changes when wall time is set.
    #[pyfunction]
    fn realtime_offset_ns() -> i64 {
        conduit_ring::clock::realtime_offset_ns()
    }
}
