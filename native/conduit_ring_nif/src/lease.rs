//! Messages that are lent to processes in their slots, without a copy.
//!
//! Two kinds of terms refer to a lease: the handle, with which the user releases it, and the
//! binary over the slot with all its sub-binaries. A binary on the BEAM must stay valid and
//! constant while a process refers to it. So releasing a lease frees the slot if no binary is
//! left. Otherwise the lease is detached: the pages under the binary become a private copy, which
//! lives as long as the binary.

use std::sync::{Arc, Mutex, PoisonError};

use conduit_ring::{Lease, Meta};
use rustler::{Atom, Binary, Encoder, Env, NifResult, Resource, ResourceArc, Term};

use crate::buffer::Buffer;
use crate::terms;

/// The longest message for which a copy costs less than lending.
const LONGEST_COPY: usize = 64 * 1024;

/// The owner of a binary over a slot.
pub struct BinaryResource(#[expect(dead_code, reason = "kept alive")] Arc<Lent>);

/// The handle with which the user releases a lease.
pub struct LeaseResource(Mutex<Option<Arc<Lent>>>);

struct Lent(Mutex<Lease>);

#[rustler::resource_impl]
impl Resource for BinaryResource {}

#[rustler::resource_impl]
impl Resource for LeaseResource {}

impl LeaseResource {
    /// Returns the handle of a lease.
    fn new(lease: Lease) -> ResourceArc<LeaseResource> {
        let lent = Arc::new(Lent(Mutex::new(lease)));
        ResourceArc::new(LeaseResource(Mutex::new(Some(lent))))
    }

    fn lent(&self) -> Option<Arc<Lent>> {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    fn take(&self) -> Option<Arc<Lent>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Frees the slot if no binary is left, and returns whether it did.
    fn release(&self) -> bool {
        let mut lent = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match lent.take().map(Arc::try_unwrap) {
            None | Some(Ok(_)) => true,
            Some(Err(used)) => {
                *lent = Some(used);
                false
            }
        }
    }
}

impl Lent {
    /// Returns the message's metadata and a binary over its bytes.
    fn borrow<'a>(self: &Arc<Self>, env: Env<'a>) -> (Meta, Binary<'a>) {
        let lease = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (at, len) = (lease.as_ptr(), lease.len());
        let owner = ResourceArc::new(BinaryResource(self.clone()));
        // SAFETY: the resource keeps the lease, whose bytes neither move nor change until it is
        // dropped: at first because the publisher respects the lease, and once detached because
        // they are private. Peers must follow the protocol for this; leases of strangers' topics
        // are copies.
        let bytes = unsafe { std::slice::from_raw_parts(at, len) };
        // SAFETY: as above.
        let binary = unsafe { owner.make_binary_unsafe(env, |_| bytes) };
        (lease.meta(), binary)
    }

    /// Makes the bytes private and frees the slot. Without memory for that, the slot stays held
    /// as long as a binary lives.
    fn detach(&self) -> bool {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .detach()
            .is_ok()
    }
}

impl Drop for LeaseResource {
    /// Detaches the lease if the user died and a binary is left. A thread does it, because a
    /// destructor must not copy a large message.
    fn drop(&mut self) {
        if let Some(Err(lent)) = self.take().map(Arc::try_unwrap) {
            let thread = std::thread::Builder::new().name("bb_ring_detach".into());
            // Without a thread the slot stays held as long as the binary lives.
            let _ = thread.spawn(move || lent.detach());
        }
    }
}

/// Lends a message: returns the handle of its lease. A short message is copied and returned
/// itself.
pub fn lend(env: Env<'_>, lease: Lease) -> Term<'_> {
    let meta = lease.meta();
    if meta.len > LONGEST_COPY {
        return LeaseResource::new(lease).encode(env);
    }
    let mut data = Buffer::with_len(meta.len);
    lease.read_at(0, data.as_mut());
    terms::message(env, meta, data)
}

/// Returns the lent message. The calling process creates the binary, so that other processes with
/// the handle do not keep the slot from being freed.
#[rustler::nif]
fn lease_message(env: Env, lease: ResourceArc<LeaseResource>) -> NifResult<Term> {
    let lent = lease.lent().ok_or(rustler::Error::BadArg)?;
    let (meta, data) = lent.borrow(env);
    Ok(terms::lent_message(env, meta, data))
}

/// Returns `true` when the slot was freed, `false` when a binary over it is left.
#[rustler::nif]
fn lease_release(lease: ResourceArc<LeaseResource>) -> bool {
    lease.release()
}

/// Frees the slot although a binary is left, which keeps its bytes.
#[rustler::nif(schedule = "DirtyCpu")]
fn lease_detach(lease: ResourceArc<LeaseResource>) -> Atom {
    if let Some(lent) = lease.take() {
        let _ = lent.detach();
    }
    rustler::types::atom::ok()
}
