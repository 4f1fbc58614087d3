//! Ending a wait from another thread.

use std::ffi::c_int;

use conduit_ring::Waker;

use crate::failure::{answer, quietly};
use crate::pointer;

/// Opaque to C.
pub(crate) struct conduit_ring_waker(pub(crate) Waker);

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_waker_wake(waker: *const conduit_ring_waker) -> c_int {
    answer(|| {
        // SAFETY: null or a living waker, by the header.
        unsafe { pointer::shared(waker, "waker") }?.0.wake();
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_waker_free(waker: *mut conduit_ring_waker) {
    quietly((), || {
        // SAFETY: null or made by conduit_ring_subscriber_waker, by the header.
        drop(unsafe { pointer::give_back(waker) });
    });
}
