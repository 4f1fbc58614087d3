//! A message that is looked at where it lies.

use std::ffi::c_void;
use std::ptr;

use conduit_ring::{Lease, Meta};

use crate::failure::quietly;
use crate::message::conduit_ring_meta;
use crate::pointer;

/// Opaque to C.
pub(crate) struct conduit_ring_lease {
    meta: conduit_ring_meta,
    bytes: Bytes,
}

enum Bytes {
    Lent(Lease),
    /// Was taken out of the ring before.
    Kept(Vec<u8>),
}

impl conduit_ring_lease {
    pub(crate) fn of_copy(meta: Meta, bytes: Vec<u8>) -> Self {
        conduit_ring_lease {
            meta: meta.into(),
            bytes: Bytes::Kept(bytes),
        }
    }

    fn data(&self) -> *const u8 {
        match &self.bytes {
            Bytes::Lent(lease) => lease.as_ptr(),
            Bytes::Kept(bytes) => bytes.as_ptr(),
        }
    }

    fn holds_slot(&self) -> bool {
        matches!(&self.bytes, Bytes::Lent(lease) if lease.holds_slot())
    }
}

impl From<Lease> for conduit_ring_lease {
    fn from(lease: Lease) -> Self {
        conduit_ring_lease {
            meta: lease.meta().into(),
            bytes: Bytes::Lent(lease),
        }
    }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_lease_data(lease: *const conduit_ring_lease) -> *const c_void {
    // SAFETY: null or a lease that was not released, by the header.
    let lease = unsafe { lease.as_ref() };
    lease.map_or(ptr::null(), |lease| lease.data().cast())
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_lease_meta(
    lease: *const conduit_ring_lease,
) -> conduit_ring_meta {
    // SAFETY: null or a lease that was not released, by the header.
    let lease = unsafe { lease.as_ref() };
    lease.map_or(conduit_ring_meta::default(), |lease| lease.meta)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_lease_holds_slot(lease: *const conduit_ring_lease) -> bool {
    // SAFETY: null or a lease that was not released, by the header.
    let lease = unsafe { lease.as_ref() };
    lease.is_some_and(conduit_ring_lease::holds_slot)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_lease_release(lease: *mut conduit_ring_lease) {
    quietly((), || {
        // SAFETY: null or made by conduit_ring_subscriber_lease and released for the first time, by the header.
        drop(unsafe { pointer::give_back(lease) });
    });
}
