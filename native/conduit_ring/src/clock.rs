//! The clock of the ring: `CLOCK_MONOTONIC_RAW`, in nanoseconds.
//!
//! Every message carries its time ([`Meta::timestamp_ns`](crate::Meta::timestamp_ns)). The age of
//! a message is a subtraction, in whatever process it is read:
//!
//! ```
//! use conduit_ring::{Publisher, PublisherOptions, Read, Subscriber, Topic, clock};
//!
//! # let name = format!("doc-clock-{}", std::process::id());
//! let topic = Topic::new(&name)?;
//! let mut publisher = Publisher::open(&topic, &PublisherOptions::default())?;
//! let mut subscriber = Subscriber::open(&topic, &Default::default())?;
//! publisher.publish(b"12.5 degrees").unwrap();
//! let Read::Message(meta) = subscriber.try_read(&mut Vec::new())? else {
//!     panic!("expected a message");
//! };
//! let age_ns = clock::now_ns() - meta.timestamp_ns;
//! let wall_time_ns = meta.timestamp_ns as i64 + clock::realtime_offset_ns();
//! # assert!(age_ns < 60_000_000_000 && wall_time_ns > 1_600_000_000_000_000_000);
//! # Ok::<(), conduit_ring::Error>(())
//! ```

use crate::os;

/// Returns the time on the clock that stamps every message, in nanoseconds.
///
/// The clock never steps, no time service slows it, and all processes of one machine share it. It
/// begins anew when the machine starts.
#[inline]
pub fn now_ns() -> u64 {
    os::monotonic_raw_ns()
}

/// Returns what to add to [`now_ns`] to get wall time: `CLOCK_REALTIME`, in nanoseconds since
/// 1970.
///
/// The answer is true now. Wall time steps when it is set, so do not keep the offset for long.
pub fn realtime_offset_ns() -> i64 {
    os::realtime_ns().wrapping_sub(now_ns() as i64)
}
