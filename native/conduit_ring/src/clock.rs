//! The clock of the ring: `CLOCK_MONOTONIC_RAW`, in nanoseconds.

use crate::os;

/// Now, on the clock that stamps every message (`CLOCK_MONOTONIC_RAW`), in nanoseconds. It never steps, and all
/// processes of one machine share it.
#[inline]
pub fn now_ns() -> u64 {
    os::monotonic_raw_ns()
}

/// What to add to [`now_ns`] to get wall time (`CLOCK_REALTIME`, nanoseconds since 1970), as of now: wall time steps.
pub fn realtime_offset_ns() -> i64 {
    os::realtime_ns().wrapping_sub(now_ns() as i64)
}
