//! A message that is read in its slot, without a copy.

use std::ffi::c_void;
use std::ptr;

use conduit_ring::{Lease, Meta};

use crate::failure::infallible;
use crate::message::conduit_ring_meta;
use crate::pointer;

/// The opaque handle of a lease.
pub(crate) struct conduit_ring_lease {
    meta: conduit_ring_meta,
    bytes: Bytes,
}

enum Bytes {
    Leased(Lease),
    /// A copy that a read kept earlier.
    Copied(Vec<u8>),
}

impl conduit_ring_lease {
    pub(crate) fn of_copy(meta: Meta, bytes: Vec<u8>) -> Self {
        conduit_ring_lease {
            meta: meta.into(),
            bytes: Bytes::Copied(bytes),
        }
    }

    fn data(&self) -> *const u8 {
        match &self.bytes {
            Bytes::Leased(lease) => lease.as_ptr(),
            Bytes::Copied(bytes) => bytes.as_ptr(),
        }
    }

    fn holds_slot(&self) -> bool {
        matches!(&self.bytes, Bytes::Leased(lease) if lease.holds_slot())
    }
}

impl From<Lease> for conduit_ring_lease {
    fn from(lease: Lease) -> Self {
        conduit_ring_lease {
            meta: lease.meta().into(),
            bytes: Bytes::Leased(lease),
        }
    }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_lease_data(lease: *const conduit_ring_lease) -> *const c_void {
    // SAFETY: null or a lease that was not released, as the header demands.
    let lease = unsafe { lease.as_ref() };
    lease.map_or(ptr::null(), |lease| lease.data().cast())
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_lease_meta(
    lease: *const conduit_ring_lease,
) -> conduit_ring_meta {
    // SAFETY: null or a lease that was not released, as the header demands.
    let lease = unsafe { lease.as_ref() };
    lease.map_or(conduit_ring_meta::default(), |lease| lease.meta)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_lease_holds_slot(lease: *const conduit_ring_lease) -> bool {
    // SAFETY: null or a lease that was not released, as the header demands.
    let lease = unsafe { lease.as_ref() };
    lease.is_some_and(conduit_ring_lease::holds_slot)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_lease_release(lease: *mut conduit_ring_lease) {
    infallible((), || {
        // SAFETY: null or a lease that was not released, as the header demands.
        drop(unsafe { pointer::take(lease) });
    });
}
