//! The native half of the Python package `conduit_ring`: Python's objects ⇄ the ring, no protocol.

mod bytes;
mod content;
mod errors;
mod fork;
mod info;
mod lease;
mod loan;
mod message;
mod publisher;
mod subscriber;
mod timeout;

/// What `conduit_ring/__init__.py` gathers.
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

    /// Now, in nanoseconds, on the clock that stamps every message (CLOCK_MONOTONIC_RAW).
    ///
    /// It never steps, and all processes of one machine share it: ``now_ns() - message.timestamp_ns`` is a message's age.
    #[pyfunction]
    fn now_ns() -> u64 {
        conduit_ring::clock::now_ns()
    }

    /// What to add to :func:`now_ns` to get wall time (nanoseconds since 1970), as of now: wall time steps.
    #[pyfunction]
    fn realtime_offset_ns() -> i64 {
        conduit_ring::clock::realtime_offset_ns()
    }
}
