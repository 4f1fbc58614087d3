//! A message that was copied out of a ring, in a buffer that grows.

use std::ffi::c_void;
use std::ptr;

use conduit_ring::Meta;

use crate::failure::{infallible, status};
use crate::pointer::{self, Out};

/// The metadata of a message.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct conduit_ring_meta {
    /// The sequence number.
    pub sequence: u64,
    /// The time of publication.
    pub timestamp_ns: u64,
    /// Messages lost just before this one.
    pub lost: u64,
    /// The size of the message.
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

/// The opaque handle of a buffer.
#[derive(Default)]
pub(crate) struct conduit_ring_message {
    pub(crate) buffer: Vec<u8>,
    pub(crate) meta: conduit_ring_meta,
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_message_new(
    message: *mut *mut conduit_ring_message,
) -> std::ffi::c_int {
    status(|| {
        let create = || Ok(conduit_ring_message::default());
        // SAFETY: null or writable, as the header demands.
        unsafe { Out::handle(message, "message", create) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_message_free(message: *mut conduit_ring_message) {
    infallible((), || {
        // SAFETY: null or a message that was not freed, as the header demands.
        drop(unsafe { pointer::take(message) });
    });
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_message_data(
    message: *const conduit_ring_message,
) -> *const c_void {
    // SAFETY: null or a message that no thread reads into, as the header demands.
    let message = unsafe { message.as_ref() };
    message.map_or(ptr::null(), |message| message.buffer.as_ptr().cast())
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_message_meta(
    message: *const conduit_ring_message,
) -> conduit_ring_meta {
    // SAFETY: null or a message that no thread reads into, as the header demands.
    let message = unsafe { message.as_ref() };
    message.map_or(conduit_ring_meta::default(), |message| message.meta)
}
