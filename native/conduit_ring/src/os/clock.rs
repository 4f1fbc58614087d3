//! The two clocks of a ring.

use nix::time::{ClockId, clock_gettime};

/// Returns the time of `CLOCK_MONOTONIC_RAW` in nanoseconds.
#[inline]
pub(crate) fn monotonic_raw_ns() -> u64 {
    clock_ns(ClockId::CLOCK_MONOTONIC_RAW)
}

/// Returns the time of `CLOCK_REALTIME` in nanoseconds since 1970.
pub(crate) fn realtime_ns() -> i64 {
    clock_ns(ClockId::CLOCK_REALTIME) as i64
}

/// Both clocks exist on every Linux that has OFD locks, so that the call cannot fail.
#[inline]
fn clock_ns(id: ClockId) -> u64 {
    clock_gettime(id).map_or(0, |now| {
        (now.tv_sec() as u64)
            .wrapping_mul(1_000_000_000)
            .wrapping_add(now.tv_nsec() as u64)
    })
}
