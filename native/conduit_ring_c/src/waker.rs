//! A handle that ends a wait from another thread.

use std::ffi::c_int;

use conduit_ring::Waker;

use crate::failure::{infallible, status};
use crate::pointer;

/// The opaque handle of a waker.
pub(crate) struct conduit_ring_waker(pub(crate) Waker);

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_waker_wake(waker: *const conduit_ring_waker) -> c_int {
    status(|| {
        // SAFETY: null or a waker that was not freed, as the header demands.
        unsafe { pointer::shared(waker, "waker") }?.0.wake();
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_waker_free(waker: *mut conduit_ring_waker) {
    infallible((), || {
        // SAFETY: null or a waker that was not freed, as the header demands.
        drop(unsafe { pointer::take(waker) });
    });
}
