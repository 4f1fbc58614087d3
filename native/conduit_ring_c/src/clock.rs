//! The clock that stamps messages.

use crate::failure::infallible;

#[unsafe(no_mangle)]
extern "C" fn conduit_ring_clock_now_ns() -> u64 {
    infallible(0, conduit_ring::clock::now_ns)
}

#[unsafe(no_mangle)]
extern "C" fn conduit_ring_clock_realtime_offset_ns() -> i64 {
    infallible(0, conduit_ring::clock::realtime_offset_ns)
}
