//! Sends terms to the owner of a subscription and to callers.

use conduit_ring::{ContentTag, Lease, Meta};
use rustler::env::SavedTerm;
use rustler::{Atom, Encoder, Env, LocalPid, OwnedEnv, Reference, Term};

use crate::buffer::Buffer;
use crate::lease;
use crate::terms::{self, atoms, failure};

/// Sends terms with the subscription's reference. Reuses one environment for all messages.
pub struct Sender {
    owner: LocalPid,
    env: OwnedEnv,
    reference: SavedTerm,
    reference_env: OwnedEnv,
}

impl Sender {
    pub fn new(owner: LocalPid, reference: Reference) -> Self {
        let reference_env = OwnedEnv::new();
        let reference = reference_env.save(reference);
        Self {
            owner,
            env: OwnedEnv::new(),
            reference,
            reference_env,
        }
    }

    pub fn send_message(&mut self, meta: Meta, data: Buffer) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            (atoms::bb_ring(), reference, terms::message(env, meta, data)).encode(env)
        });
    }

    pub fn send_event(&mut self, event: Atom) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            (atoms::bb_ring(), reference, event).encode(env)
        });
    }

    pub fn send_error(&mut self, error: &conduit_ring::Error) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            (atoms::bb_ring(), reference, failure(env, error)).encode(env)
        });
    }

    pub fn send_other_content(&mut self, found: ContentTag) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            let error = terms::other_content(env, found);
            (atoms::bb_ring(), reference, error).encode(env)
        });
    }

    pub fn send_passive(&mut self) {
        let owner = self.owner;
        self.send(&owner, |env, reference| {
            (atoms::bb_ring_passive(), reference).encode(env)
        });
    }

    pub fn send_closed(&mut self, closer: &LocalPid) {
        self.send(closer, |env, reference| {
            (atoms::bb_ring_closed(), reference).encode(env)
        });
    }

    pub fn answer(&mut self, to: &LocalPid, id: u64, result: Result<(Meta, Buffer), Atom>) {
        self.send(to, |env, reference| {
            let result = match result {
                Ok((meta, data)) => terms::ok(env, terms::message(env, meta, data)),
                Err(reason) => terms::error(env, reason),
            };
            (atoms::bb_ring_reply(), reference, id, result).encode(env)
        });
    }

    pub fn lend(&mut self, to: &LocalPid, id: u64, lease: Result<Lease, Atom>) {
        self.send(to, |env, reference| {
            let result = match lease {
                Ok(lease) => terms::ok(env, lease::lend(env, lease)),
                Err(reason) => terms::error(env, reason),
            };
            (atoms::bb_ring_reply(), reference, id, result).encode(env)
        });
    }

    /// Sends a term. A failure is ignored: the monitor ends the subscription of a dead receiver.
    fn send(&mut self, to: &LocalPid, build: impl for<'a> FnOnce(Env<'a>, Term<'a>) -> Term<'a>) {
        let Self {
            env,
            reference,
            reference_env,
            ..
        } = self;
        let _ = env.send_and_clear(to, |env| {
            let reference = reference_env.run(|own| reference.load(own).in_env(env));
            build(env, reference)
        });
    }
}
