//! The state that callers of a subscriber share with its thread.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use conduit_ring::Waker;
use rustler::{Env, LocalPid, Monitor, NifUnitEnum, Resource};

use crate::demand::{Demand, Next};

/// A subscriber as a resource.
pub struct SubscriberResource(pub Shared);

/// The state that callers and the thread share.
pub struct Shared {
    state: Mutex<State>,
    changed: Condvar,
    waker: Waker,
    last_request: AtomicU64,
}

/// The part of the state behind the lock.
#[derive(Default)]
pub struct State {
    pub demand: Demand<Caller>,
    pub closing: bool,
    /// The processes to notify when the thread has released the ring.
    pub closers: Vec<LocalPid>,
    pub ended: bool,
}

/// The caller of a request and the kind of message that it wants.
pub struct Caller {
    pub pid: LocalPid,
    pub kind: Kind,
}

/// The kind of message that a request wants.
#[derive(Clone, Copy, Debug, NifUnitEnum)]
pub enum Kind {
    /// The next message, when it arrives.
    Next,
    /// The newest message, or the answer that there is none.
    Latest,
    /// As `Latest`, without a copy.
    Frame,
}

#[rustler::resource_impl]
impl Resource for SubscriberResource {
    const IMPLEMENTS_DOWN: bool = true;

    /// Closes the subscription when its owner dies.
    fn down<'a>(&'a self, _env: Env<'a>, _pid: LocalPid, _monitor: Monitor) {
        self.0.close(None);
    }
}

impl Shared {
    pub fn new(waker: Waker) -> Self {
        Self {
            state: Mutex::default(),
            changed: Condvar::new(),
            waker,
            last_request: AtomicU64::new(0),
        }
    }
    /// Returns a number for a new request.
    pub fn next_request(&self) -> u64 {
        self.last_request.fetch_add(1, Ordering::Relaxed)
    }

    /// Locks the state. No caller waits for anything while it holds the lock.
    pub fn lock(&self) -> MutexGuard<'_, State> {
        self.state
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Changes the state and wakes the thread, wherever it sleeps.
    pub fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let result = change(&mut self.lock());
        self.changed.notify_one();
        self.waker.wake();
        result
    }

    /// Requests the end of the thread. Returns `false` when it has ended, so that no notification
    /// follows.
    pub fn close(&self, closer: Option<LocalPid>) -> bool {
        self.change(|state| {
            state.closing = true;
            state.closers.extend(closer);
            !state.ended
        })
    }

    /// Returns the thread's next step; waits while there is no demand. Returns `None` when the
    /// thread is to end.
    pub fn next(&self) -> Option<Next<Caller>> {
        let mut state = self.lock();
        loop {
            if state.closing {
                return None;
            }
            match state.demand.next() {
                Next::Park => {
                    state = self
                        .changed
                        .wait(state)
                        .unwrap_or_else(|poisoned| poisoned.into_inner())
                }
                next => return Some(next),
            }
        }
    }

    /// Waits for a change of the state, at most for `timeout`.
    pub fn pause(&self, timeout: Duration) {
        let state = self.lock();
        let _ = self.changed.wait_timeout(state, timeout);
    }
}
