//! Messages lent to processes in their slots.
//!
//! Two things refer to a lease: the handle, by which its user gives it back, and the binary over the slot, with all parts of it
//! that the user has made, wherever these have got to. Erlang's binaries never change and never go away under their users. So
//! the slot is simply given back when no binary is left by then, and otherwise the lease is detached: the pages under the
//! binary become a private copy of themselves, and live as long as the binary does.

use std::sync::{Arc, Mutex, PoisonError};

use conduit_ring::{Lease, Meta};
use rustler::{Atom, Binary, Env, NifResult, Resource, ResourceArc, Term};

use crate::terms;

/// What the binaries refer to.
pub struct BinaryResource(#[expect(dead_code, reason = "kept alive")] Arc<Lent>);

/// What the user gives back.
pub struct LeaseResource(Mutex<Option<Arc<Lent>>>);

struct Lent(Mutex<Lease>);

#[rustler::resource_impl]
impl Resource for BinaryResource {}

#[rustler::resource_impl]
impl Resource for LeaseResource {}

impl LeaseResource {
    /// The handle of a lease.
    pub fn new(lease: Lease) -> ResourceArc<LeaseResource> {
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

    /// Gives the slot back if no binary is left.
    fn release(&self) -> bool {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match held.take().map(Arc::try_unwrap) {
            None | Some(Ok(_)) => true,
            Some(Err(lent)) => {
                *held = Some(lent);
                false
            }
        }
    }
}

impl Lent {
    /// What the message says about itself, and a binary over its bytes.
    fn borrow<'a>(self: &Arc<Self>, env: Env<'a>) -> (Meta, Binary<'a>) {
        let lease = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (at, len) = (lease.as_ptr(), lease.len());
        let owner = ResourceArc::new(BinaryResource(self.clone()));
        // SAFETY: the resource holds the lease, whose bytes stay where they are and what they are until it is dropped: first
        // since its publisher respects it, and then, detached, since they are private. That peers keep to the protocol is
        // the condition for lending at all: of strangers' topics leases are copies.
        let bytes = unsafe { std::slice::from_raw_parts(at, len) };
        // SAFETY: as above.
        let binary = unsafe { owner.make_binary_unsafe(env, |_| bytes) };
        (lease.meta(), binary)
    }

    /// If there is no memory for that, the slot stays held as long as a binary lives.
    fn detach(&self) -> bool {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .detach()
            .is_ok()
    }
}

impl Drop for LeaseResource {
    /// The user died with the handle, and a binary lives on. No destructor copies.
    fn drop(&mut self) {
        if let Some(Err(lent)) = self.take().map(Arc::try_unwrap) {
            let thread = std::thread::Builder::new().name("bb_ring_detach".into());
            // Without a thread the slot stays held as long as the binary lives.
            let _ = thread.spawn(move || lent.detach());
        }
    }
}

/// The message that is lent. Its binary is made by the one who uses it: whatever else refers to the lease is not the binary's
/// user, and does not keep the slot from being given back.
#[rustler::nif]
fn lease_message(env: Env, lease: ResourceArc<LeaseResource>) -> NifResult<Term> {
    let lent = lease.lent().ok_or(rustler::Error::BadArg)?;
    let (meta, data) = lent.borrow(env);
    Ok(terms::lent_message(env, meta, data))
}

/// True when the slot was given back; false when a binary over it is still there.
#[rustler::nif]
fn lease_release(lease: ResourceArc<LeaseResource>) -> bool {
    lease.release()
}

/// Gives the slot back although a binary is still there, which keeps its bytes.
#[rustler::nif(schedule = "DirtyCpu")]
fn lease_detach(lease: ResourceArc<LeaseResource>) -> Atom {
    if let Some(lent) = lease.take() {
        let _ = lent.detach();
    }
    rustler::types::atom::ok()
}
