//! The state of a subscriber, which its leases share: reading and waiting.

use std::sync::atomic::{
    AtomicBool, AtomicU64,
    Ordering::{Relaxed, SeqCst},
};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use conduit_ring::{Error, Received, Waker};
use pyo3::exceptions::{PyRuntimeError, PyTimeoutError};
use pyo3::prelude::*;

use crate::errors;
use crate::fork::{Birth, Own};
use crate::timeout::Deadline;

/// A function that takes the next message, such as a copy or a lease.
pub(crate) type Take<T> = fn(&mut conduit_ring::Subscriber) -> Result<Received<T>, Error>;

/// A subscriber behind a lock.
pub(crate) struct Subscription {
    topic: String,
    birth: Birth,
    waker: Waker,
    inner: Mutex<Option<Own<conduit_ring::Subscriber>>>,
    closed: AtomicBool,
    reading: AtomicBool,
    publisher_up: AtomicBool,
    delivered: AtomicU64,
    lost: AtomicU64,
}

impl Subscription {
    pub(crate) fn new(subscriber: conduit_ring::Subscriber) -> Subscription {
        Subscription {
            topic: subscriber.topic().name().to_owned(),
            birth: Birth::now(),
            waker: subscriber.waker(),
            publisher_up: AtomicBool::new(subscriber.publisher_up()),
            inner: Mutex::new(Some(Own::new(subscriber))),
            closed: AtomicBool::new(false),
            reading: AtomicBool::new(false),
            delivered: AtomicU64::new(0),
            lost: AtomicU64::new(0),
        }
    }

    /// Waits for a message and takes it with `take`. Skips events of the publisher.
    pub(crate) fn next_message<T: Send>(
        &self,
        py: Python<'_>,
        deadline: Deadline,
        take: Take<T>,
    ) -> PyResult<T> {
        let _turn = self.start_reading()?;
        loop {
            if let Received::Message(_, message) = self.wait(py, deadline, take)? {
                return Ok(message);
            }
        }
    }

    /// Returns the next message if there is one. Skips events of the publisher.
    pub(crate) fn try_message<T: Send>(
        &self,
        py: Python<'_>,
        take: Take<T>,
    ) -> PyResult<Option<T>> {
        let _turn = self.start_reading()?;
        loop {
            match self.step(py, Duration::ZERO, take)? {
                Received::Message(_, message) => return Ok(Some(message)),
                Received::Nothing => return Ok(None),
                Received::PublisherUp | Received::PublisherDown => {}
            }
        }
    }

    /// Waits for the next message or event of the publisher.
    pub(crate) fn next_event<T: Send>(
        &self,
        py: Python<'_>,
        deadline: Deadline,
        take: Take<T>,
    ) -> PyResult<Received<T>> {
        let _turn = self.start_reading()?;
        self.wait(py, deadline, take)
    }

    /// Closes the subscriber and ends a wait. Does nothing in a child of the process that opened
    /// it.
    pub(crate) fn close(&self, py: Python<'_>) {
        if !self.birth.is_here() {
            return;
        }
        self.closed.store(true, SeqCst);
        self.waker.wake();
        py.detach(|| drop(self.lock().take()));
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.closed.load(SeqCst) || !self.birth.is_here()
    }

    pub(crate) fn publisher_up(&self) -> bool {
        self.publisher_up.load(Relaxed)
    }

    pub(crate) fn delivered(&self) -> u64 {
        self.delivered.load(Relaxed)
    }

    pub(crate) fn lost(&self) -> u64 {
        self.lost.load(Relaxed)
    }

    /// Waits in slices, between which Python's signal handlers run. They may close this
    /// subscriber, so no lock is held then.
    fn wait<T: Send>(
        &self,
        py: Python<'_>,
        deadline: Deadline,
        take: Take<T>,
    ) -> PyResult<Received<T>> {
        loop {
            let slice = deadline.slice();
            match self.step(py, slice, take)? {
                Received::Nothing if slice.is_zero() => {
                    return Err(PyTimeoutError::new_err(format!(
                        "timeout while waiting for a message on {:?}",
                        self.topic
                    )));
                }
                Received::Nothing => py.check_signals()?,
                received => return Ok(received),
            }
        }
    }

    fn step<T: Send>(
        &self,
        py: Python<'_>,
        timeout: Duration,
        take: Take<T>,
    ) -> PyResult<Received<T>> {
        let received = py.detach(|| {
            let mut guard = self.lock();
            let Some(subscriber) = guard.as_mut().filter(|_| !self.closed.load(SeqCst)) else {
                return Ok(None);
            };
            let received = take_in_time(subscriber.get(), timeout, take);
            self.publisher_up
                .store(subscriber.get().publisher_up(), Relaxed);
            received.map(Some)
        });
        let received = received
            .map_err(errors::of_ring)?
            .ok_or_else(|| errors::closed("subscriber"))?;
        if let Received::Message(meta, _) = received {
            self.delivered.fetch_add(1, Relaxed);
            self.lost.fetch_add(meta.lost, Relaxed);
        }
        Ok(received)
    }

    fn start_reading(&self) -> PyResult<Turn<'_>> {
        self.birth.check("subscriber")?;
        if self.reading.swap(true, SeqCst) {
            return Err(PyRuntimeError::new_err(
                "subscriber is being read already, by another thread or by the code that a \
                 signal handler interrupted",
            ));
        }
        Ok(Turn(&self.reading))
    }

    fn lock(&self) -> MutexGuard<'_, Option<Own<conduit_ring::Subscriber>>> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Takes the next message. Waits once if there is none yet.
fn take_in_time<T>(
    subscriber: &mut conduit_ring::Subscriber,
    timeout: Duration,
    take: Take<T>,
) -> Result<Received<T>, Error> {
    match take(subscriber)? {
        Received::Nothing if !timeout.is_zero() => {
            subscriber.wait(timeout)?;
            take(subscriber)
        }
        received => Ok(received),
    }
}

/// The right of one thread to read. Ends on drop.
struct Turn<'a>(&'a AtomicBool);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.store(false, SeqCst);
    }
}
