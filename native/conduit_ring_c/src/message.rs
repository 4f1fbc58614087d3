//! A message taken out of a ring, in a buffer that grows.

use std::ffi::c_void;
use std::ptr;

use conduit_ring::Meta;

use crate::failure::{answer, quietly};
use crate::pointer::{self, Out};

/// What a message says about itself.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct conduit_ring_meta {
    /// Its number.
    pub sequence: u64,
    /// When it was published.
    pub timestamp_ns: u64,
    /// Messages lost just before it.
    pub lost: u64,
    /// Its length.
    pub size_bytes: usize,
}

impl From<Meta> for conduit_ring_meta {
    fn from(meta: Meta) -> Self {
        conduit_ring_meta {
            sequence: meta.sequence,
            timestamp_ns: meta.timestamp_ns,
            lost: meta.lost,
            size_bytes: meta.len,
        }
    }
}

/// Opaque to C.
#[derive(Default)]
pub(crate) struct conduit_ring_message {
    pub(crate) buffer: Vec<u8>,
    pub(crate) meta: conduit_ring_meta,
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_message_new(
    message: *mut *mut conduit_ring_message,
) -> std::ffi::c_int {
    answer(|| {
        let make = || Ok(conduit_ring_message::default());
        // SAFETY: null or writable, by the header.
        unsafe { Out::handle(message, "message", make) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_message_free(message: *mut conduit_ring_message) {
    quietly((), || {
        // SAFETY: null or made by conduit_ring_message_new, by the header.
        drop(unsafe { pointer::give_back(message) });
    });
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_message_data(
    message: *const conduit_ring_message,
) -> *const c_void {
    // SAFETY: null or a message that is not being read into, by the header.
    let message = unsafe { message.as_ref() };
    message.map_or(ptr::null(), |message| message.buffer.as_ptr().cast())
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_message_meta(
    message: *const conduit_ring_message,
) -> conduit_ring_meta {
    // SAFETY: null or a message that is not being read into, by the header.
    let message = unsafe { message.as_ref() };
    message.map_or(conduit_ring_meta::default(), |message| message.meta)
}
