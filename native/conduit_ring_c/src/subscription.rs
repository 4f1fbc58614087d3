//! The state behind a subscriber's handle: reading, leasing and waiting.

use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::{Duration, Instant};

use conduit_ring::{Meta, Read, Received, Subscriber, Wait};

use crate::caller_buffer::{CallerBuffer, Target};
use crate::errno;
use crate::failure::Failure;
use crate::lease::conduit_ring_lease;
use crate::message::{conduit_ring_message, conduit_ring_meta};
use crate::pointer::{self, Out};

/// `event`: a message.
pub const CONDUIT_RING_EVENT_MESSAGE: u32 = 1;
/// `event`: the topic has a publisher.
pub const CONDUIT_RING_EVENT_PUBLISHER_UP: u32 = 2;
/// `event`: the publisher stopped.
pub const CONDUIT_RING_EVENT_PUBLISHER_DOWN: u32 = 3;

/// The longest time until `await_topic` sees a topic that exists without a publisher.
const LONGEST_AWAIT: Duration = Duration::from_millis(100);

/// The opaque handle of a subscriber. No thread waits for the lock: it turns use by two threads
/// at once into an error.
pub(crate) struct conduit_ring_subscriber(Mutex<Inner>);

pub(crate) struct Inner {
    pub(crate) subscriber: Subscriber,
    /// A message that did not fit into the caller's buffer, for the next read.
    kept_message: Option<(Meta, Vec<u8>)>,
}

/// The event that a read returned.
pub(crate) enum Event {
    Message,
    PublisherUp,
    PublisherDown,
}

impl Event {
    pub(crate) fn value(self) -> u32 {
        match self {
            Event::Message => CONDUIT_RING_EVENT_MESSAGE,
            Event::PublisherUp => CONDUIT_RING_EVENT_PUBLISHER_UP,
            Event::PublisherDown => CONDUIT_RING_EVENT_PUBLISHER_DOWN,
        }
    }
}

impl conduit_ring_subscriber {
    pub(crate) fn new(subscriber: Subscriber) -> conduit_ring_subscriber {
        conduit_ring_subscriber(Mutex::new(Inner {
            subscriber,
            kept_message: None,
        }))
    }

    fn lock(&self) -> Result<MutexGuard<'_, Inner>, Failure> {
        self.0.try_lock().map_err(|error| match error {
            TryLockError::Poisoned(_) => Failure::broken("subscriber"),
            TryLockError::WouldBlock => Failure::new(
                errno::EALREADY,
                "subscriber is in use by another thread; use it from one thread at a time",
            ),
        })
    }
}

/// Locks the state behind a handle.
///
/// # Safety
/// `subscriber` is null or open for `'a`.
pub(crate) unsafe fn lock<'a>(
    subscriber: *mut conduit_ring_subscriber,
) -> Result<MutexGuard<'a, Inner>, Failure> {
    // SAFETY: the caller guarantees the same.
    unsafe { pointer::shared(subscriber, "subscriber") }?.lock()
}

impl Inner {
    pub(crate) fn try_read(
        &mut self,
        message: &mut conduit_ring_message,
    ) -> Result<Event, Failure> {
        message.meta = conduit_ring_meta::default();
        if let Some((meta, buffer)) = self.kept_message.take() {
            message.buffer = buffer;
            message.meta = meta.into();
            return Ok(Event::Message);
        }
        match self.subscriber.try_read(&mut message.buffer)? {
            Read::Message(meta) => {
                message.meta = meta.into();
                Ok(Event::Message)
            }
            Read::PublisherUp => Ok(Event::PublisherUp),
            Read::PublisherDown => Ok(Event::PublisherDown),
            Read::Nothing => Err(Failure::NOTHING),
        }
    }

    pub(crate) fn read(
        &mut self,
        message: &mut conduit_ring_message,
        timeout: Duration,
    ) -> Result<Event, Failure> {
        self.in_time(timeout, |inner| inner.try_read(message))
    }

    /// Calls `take` until it returns an event, and waits between the calls.
    pub(crate) fn in_time<T>(
        &mut self,
        timeout: Duration,
        mut take: impl FnMut(&mut Inner) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let deadline = Deadline::after(timeout);
        loop {
            match take(self) {
                Err(Failure::NOTHING) => self.wait(deadline.left())?,
                result => return result,
            }
        }
    }

    pub(crate) fn try_lease(&mut self) -> Result<(Event, Option<conduit_ring_lease>), Failure> {
        if let Some((meta, kept)) = self.kept_message.take() {
            let lease = conduit_ring_lease::of_copy(meta, kept);
            return Ok((Event::Message, Some(lease)));
        }
        match self.subscriber.try_lease()? {
            Received::Message(_, lease) => Ok((Event::Message, Some(lease.into()))),
            Received::PublisherUp => Ok((Event::PublisherUp, None)),
            Received::PublisherDown => Ok((Event::PublisherDown, None)),
            Received::Nothing => Err(Failure::NOTHING),
        }
    }

    pub(crate) fn try_read_into(
        &mut self,
        buffer: CallerBuffer,
        meta: &Out<conduit_ring_meta>,
    ) -> Result<Event, Failure> {
        let (found, target) = match self.kept_message.take() {
            Some((found, kept)) => (found, buffer.place(kept)),
            None => match self.subscriber.try_read_with(|len| buffer.prepare(len))? {
                Received::Message(found, target) => (found, target),
                Received::PublisherUp => return Ok(Event::PublisherUp),
                Received::PublisherDown => return Ok(Event::PublisherDown),
                Received::Nothing => return Err(Failure::NOTHING),
            },
        };
        meta.put(found.into());
        match target {
            Target::Caller(_) => Ok(Event::Message),
            Target::Own(kept) => {
                self.kept_message = Some((found, kept));
                Err(Failure::new(
                    errno::ENOBUFS,
                    format!(
                        "message of {} bytes does not fit into the buffer of {} bytes; \
                         it is kept for the next read",
                        found.len, buffer.capacity
                    ),
                ))
            }
        }
    }

    pub(crate) fn wait(&mut self, timeout: Duration) -> Result<(), Failure> {
        if self.kept_message.is_some() {
            return Ok(());
        }
        match self.subscriber.wait(timeout)? {
            Wait::Ready => Ok(()),
            Wait::Woken => Err(Failure::WOKEN),
            Wait::TimedOut => Err(Failure::TIMED_OUT),
        }
    }

    pub(crate) fn await_topic(&mut self, timeout: Duration) -> Result<(), Failure> {
        let deadline = Deadline::after(timeout);
        while self.subscriber.geometry().is_none() {
            let left = deadline.left();
            match self.wait(left.min(LONGEST_AWAIT)) {
                Err(Failure::TIMED_OUT) if !left.is_zero() => {}
                result => return result,
            }
        }
        Ok(())
    }

    pub(crate) fn no_topic(&self) -> Failure {
        let path = self.subscriber.topic().path().to_owned();
        conduit_ring::Error::NoTopic { path }.into()
    }
}

/// The time until which to wait; `None` waits without a timeout.
struct Deadline(Option<Instant>);

impl Deadline {
    fn after(timeout: Duration) -> Deadline {
        Deadline(Instant::now().checked_add(timeout))
    }

    fn left(&self) -> Duration {
        self.0.map_or(Duration::MAX, |deadline| {
            deadline.saturating_duration_since(Instant::now())
        })
    }
}
