//! Subscribing.

use std::ffi::{c_char, c_int, c_void};
use std::sync::{Mutex, MutexGuard, TryLockError};
use std::time::{Duration, Instant};

use conduit_ring::{
    Guard, Meta, Policy, Read, Received, Start, Stats, Subscriber, SubscriberOptions, Topic, Wait,
};

use crate::errno;
use crate::failure::{Failure, answer};
use crate::geometry::conduit_ring_geometry;
use crate::lease::conduit_ring_lease;
use crate::message::{conduit_ring_message, conduit_ring_meta};
use crate::pointer::{self, Out};
use crate::version;
use crate::waker::conduit_ring_waker;

/// Values of `start`.
pub const CONDUIT_RING_START_NEW: u32 = 0;
/// See the header.
pub const CONDUIT_RING_START_LATEST: u32 = 1;
/// See the header.
pub const CONDUIT_RING_START_HISTORY: u32 = 2;

/// Values of `policy`.
pub const CONDUIT_RING_POLICY_ALL: u32 = 0;
/// See the header.
pub const CONDUIT_RING_POLICY_LATEST: u32 = 1;

/// Values of `guard`.
pub const CONDUIT_RING_GUARD_AUTO: u32 = 0;
/// See the header.
pub const CONDUIT_RING_GUARD_ALWAYS: u32 = 1;
/// See the header.
pub const CONDUIT_RING_GUARD_NEVER: u32 = 2;

/// Values of `event`.
pub const CONDUIT_RING_EVENT_MESSAGE: u32 = 1;
/// See the header.
pub const CONDUIT_RING_EVENT_PUBLISHER_UP: u32 = 2;
/// See the header.
pub const CONDUIT_RING_EVENT_PUBLISHER_DOWN: u32 = 3;

/// How long a topic that exists but has no publisher may go unnoticed while it is awaited.
const LONGEST_AWAIT: Duration = Duration::from_millis(100);

/// How a topic is read.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct conduit_ring_subscriber_options {
    /// The header's.
    pub abi_version: u32,
    /// Which messages to begin with.
    pub start: u32,
    /// How many of the past, for `CONDUIT_RING_START_HISTORY`.
    pub history: u32,
    /// Which messages to get after falling behind.
    pub policy: u32,
    /// Whether the topic's file may be cut off without harm.
    pub guard: u32,
}

/// What a subscriber has seen so far.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct conduit_ring_stats {
    /// Messages delivered.
    pub delivered: u64,
    /// Messages lost.
    pub lost: u64,
    /// Times that the publisher's count was found behind.
    pub resyncs: u64,
}

impl From<Stats> for conduit_ring_stats {
    fn from(stats: Stats) -> Self {
        conduit_ring_stats {
            delivered: stats.delivered,
            lost: stats.lost,
            resyncs: stats.resyncs,
        }
    }
}

/// Opaque to C. The lock is never waited for: it turns use by two threads at once into an error.
pub(crate) struct conduit_ring_subscriber(Mutex<Inner>);

struct Inner {
    subscriber: Subscriber,
    /// A message that did not fit into the caller's buffer, for the next read.
    left_over: Option<(Meta, Vec<u8>)>,
}

/// What a read gave.
enum Event {
    Message,
    PublisherUp,
    PublisherDown,
}

impl Event {
    fn value(self) -> u32 {
        match self {
            Event::Message => CONDUIT_RING_EVENT_MESSAGE,
            Event::PublisherUp => CONDUIT_RING_EVENT_PUBLISHER_UP,
            Event::PublisherDown => CONDUIT_RING_EVENT_PUBLISHER_DOWN,
        }
    }
}

impl conduit_ring_subscriber {
    fn lock(&self) -> Result<MutexGuard<'_, Inner>, Failure> {
        self.0.try_lock().map_err(|error| match error {
            TryLockError::Poisoned(_) => Failure::broken("subscriber"),
            TryLockError::WouldBlock => Failure::new(
                errno::EALREADY,
                "another thread is using this subscriber; one at a time may",
            ),
        })
    }
}

/// # Safety
/// `subscriber` is null or alive for `'a`.
unsafe fn lock<'a>(
    subscriber: *mut conduit_ring_subscriber,
) -> Result<MutexGuard<'a, Inner>, Failure> {
    // SAFETY: the caller's promise is the same.
    unsafe { pointer::shared(subscriber, "subscriber") }?.lock()
}

impl Inner {
    fn try_read(&mut self, message: &mut conduit_ring_message) -> Result<Event, Failure> {
        message.meta = conduit_ring_meta::default();
        if let Some((meta, buffer)) = self.left_over.take() {
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

    fn read(
        &mut self,
        message: &mut conduit_ring_message,
        timeout: Duration,
    ) -> Result<Event, Failure> {
        self.in_time(timeout, |inner| inner.try_read(message))
    }

    /// Takes what comes next by `take`, and waits for it.
    fn in_time<T>(
        &mut self,
        timeout: Duration,
        mut take: impl FnMut(&mut Inner) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let deadline = Deadline::after(timeout);
        loop {
            match take(self) {
                Err(Failure::NOTHING) => self.wait(deadline.left())?,
                done => return done,
            }
        }
    }

    fn try_lease(&mut self) -> Result<(Event, Option<conduit_ring_lease>), Failure> {
        if let Some((meta, kept)) = self.left_over.take() {
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

    fn try_read_into(
        &mut self,
        room: Room,
        meta: &Out<conduit_ring_meta>,
    ) -> Result<Event, Failure> {
        let (found, buffer) = match self.left_over.take() {
            Some((found, kept)) => (found, room.place(kept)),
            None => match self.subscriber.try_read_with(|len| room.prepare(len))? {
                Received::Message(found, buffer) => (found, buffer),
                Received::PublisherUp => return Ok(Event::PublisherUp),
                Received::PublisherDown => return Ok(Event::PublisherDown),
                Received::Nothing => return Err(Failure::NOTHING),
            },
        };
        meta.put(found.into());
        match buffer {
            Target::Callers(_) => Ok(Event::Message),
            Target::Ours(kept) => {
                self.left_over = Some((found, kept));
                Err(Failure::new(
                    errno::ENOBUFS,
                    format!(
                        "the message has {} bytes and the buffer {}; it is kept for the next read",
                        found.len, room.capacity
                    ),
                ))
            }
        }
    }

    fn wait(&mut self, timeout: Duration) -> Result<(), Failure> {
        if self.left_over.is_some() {
            return Ok(());
        }
        match self.subscriber.wait(timeout)? {
            Wait::Ready => Ok(()),
            Wait::Woken => Err(Failure::WOKEN),
            Wait::TimedOut => Err(Failure::TIMED_OUT),
        }
    }

    fn await_topic(&mut self, timeout: Duration) -> Result<(), Failure> {
        let deadline = Deadline::after(timeout);
        while self.subscriber.geometry().is_none() {
            let left = deadline.left();
            match self.wait(left.min(LONGEST_AWAIT)) {
                Err(Failure::TIMED_OUT) if !left.is_zero() => {}
                done => return done,
            }
        }
        Ok(())
    }

    fn no_topic(&self) -> Failure {
        let path = self.subscriber.topic().path().to_owned();
        conduit_ring::Error::NoTopic { path }.into()
    }
}

/// The moment until which to wait; none is for ever.
struct Deadline(Option<Instant>);

impl Deadline {
    fn after(timeout: Duration) -> Deadline {
        Deadline(Instant::now().checked_add(timeout))
    }

    fn left(&self) -> Duration {
        self.0.map_or(Duration::MAX, |moment| {
            moment.saturating_duration_since(Instant::now())
        })
    }
}

/// The caller's buffer.
#[derive(Clone, Copy)]
struct Room {
    at: *mut u8,
    capacity: usize,
}

/// Where a message goes: the caller's buffer if it fits, else one of ours.
enum Target {
    Callers(Room),
    Ours(Vec<u8>),
}

impl Room {
    /// # Safety
    /// `buffer` is null or has `capacity` bytes that nobody else uses as long as this lives.
    unsafe fn new(buffer: *mut c_void, capacity: usize) -> Result<Room, Failure> {
        pointer::check_len(capacity, "buffer")?;
        if buffer.is_null() && capacity > 0 {
            return Err(Failure::invalid("buffer is NULL"));
        }
        Ok(Room {
            at: buffer.cast(),
            capacity,
        })
    }

    fn prepare(self, len: usize) -> Target {
        if len <= self.capacity {
            Target::Callers(Room {
                capacity: len,
                ..self
            })
        } else {
            Target::Ours(vec![0; len])
        }
    }

    fn place(self, message: Vec<u8>) -> Target {
        match self.prepare(message.len()) {
            Target::Callers(mut room) => {
                room.as_mut().copy_from_slice(&message);
                Target::Callers(room)
            }
            Target::Ours(_) => Target::Ours(message),
        }
    }
}

impl AsMut<[u8]> for Room {
    fn as_mut(&mut self) -> &mut [u8] {
        if self.capacity == 0 {
            return &mut [];
        }
        // SAFETY: not null, so many bytes and nobody else's, by the promise in `new`.
        unsafe { std::slice::from_raw_parts_mut(self.at, self.capacity) }
    }
}

impl AsMut<[u8]> for Target {
    fn as_mut(&mut self) -> &mut [u8] {
        match self {
            Target::Callers(room) => room.as_mut(),
            Target::Ours(buffer) => buffer,
        }
    }
}

fn policy(value: u32) -> Result<Policy, Failure> {
    match value {
        CONDUIT_RING_POLICY_ALL => Ok(Policy::All),
        CONDUIT_RING_POLICY_LATEST => Ok(Policy::Latest),
        _ => Err(Failure::invalid(format!(
            "policy is {value}; accepted are CONDUIT_RING_POLICY_ALL and _LATEST"
        ))),
    }
}

fn start(value: u32, history: u32) -> Result<Start, Failure> {
    match value {
        CONDUIT_RING_START_NEW => Ok(Start::New),
        CONDUIT_RING_START_LATEST => Ok(Start::Latest),
        CONDUIT_RING_START_HISTORY => Ok(Start::History(history)),
        _ => Err(Failure::invalid(format!(
            "start is {value}; accepted are CONDUIT_RING_START_NEW, _LATEST and _HISTORY"
        ))),
    }
}

fn guard(value: u32) -> Result<Guard, Failure> {
    match value {
        CONDUIT_RING_GUARD_AUTO => Ok(Guard::Auto),
        CONDUIT_RING_GUARD_ALWAYS => Ok(Guard::Always),
        CONDUIT_RING_GUARD_NEVER => Ok(Guard::Never),
        _ => Err(Failure::invalid(format!(
            "guard is {value}; accepted are CONDUIT_RING_GUARD_AUTO, _ALWAYS and _NEVER"
        ))),
    }
}

/// # Safety
/// `options` is null or leads to options.
unsafe fn read_options(
    options: *const conduit_ring_subscriber_options,
) -> Result<SubscriberOptions, Failure> {
    if options.is_null() {
        return Ok(SubscriberOptions::default());
    }
    // SAFETY: the version comes first in every version of the options.
    let abi_version = *unsafe { pointer::shared(options.cast::<u32>(), "options") }?;
    version::check(abi_version, "options")?;
    // SAFETY: they are of this version.
    let options = unsafe { pointer::shared(options, "options") }?;
    Ok(SubscriberOptions {
        start: start(options.start, options.history)?,
        policy: policy(options.policy)?,
        guard: guard(options.guard)?,
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_open(
    topic: *const c_char,
    options: *const conduit_ring_subscriber_options,
    subscriber: *mut *mut conduit_ring_subscriber,
) -> c_int {
    answer(|| {
        let open = || {
            // SAFETY: null or a text, by the header.
            let topic = Topic::found(unsafe { pointer::text(topic, "topic") }?)?;
            // SAFETY: null or options, by the header.
            let options = unsafe { read_options(options) }?;
            Ok(conduit_ring_subscriber(Mutex::new(Inner {
                subscriber: Subscriber::open(&topic, &options)?,
                left_over: None,
            })))
        };
        // SAFETY: null or writable, by the header.
        unsafe { Out::handle(subscriber, "subscriber", open) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_try_read(
    subscriber: *mut conduit_ring_subscriber,
    message: *mut conduit_ring_message,
    event: *mut u32,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(event, "event") }?;
        // SAFETY: null or a message of the caller's, by the header.
        let message = unsafe { pointer::exclusive(message, "message") }?;
        // SAFETY: null or a living subscriber, by the header.
        let event = unsafe { lock(subscriber) }?.try_read(message)?;
        out.put(event.value());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_read(
    subscriber: *mut conduit_ring_subscriber,
    message: *mut conduit_ring_message,
    timeout_ns: u64,
    event: *mut u32,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(event, "event") }?;
        // SAFETY: null or a message of the caller's, by the header.
        let message = unsafe { pointer::exclusive(message, "message") }?;
        // SAFETY: null or a living subscriber, by the header.
        let mut inner = unsafe { lock(subscriber) }?;
        out.put(inner.read(message, timeout(timeout_ns))?.value());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_try_read_into(
    subscriber: *mut conduit_ring_subscriber,
    buffer: *mut c_void,
    capacity_bytes: usize,
    meta: *mut conduit_ring_meta,
    event: *mut u32,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(event, "event") }?;
        // SAFETY: null or writable, by the header.
        let meta = unsafe { Out::new(meta, "meta") }?;
        // SAFETY: null or so many bytes of the caller's, by the header.
        let room = unsafe { Room::new(buffer, capacity_bytes) }?;
        // SAFETY: null or a living subscriber, by the header.
        let event = unsafe { lock(subscriber) }?.try_read_into(room, &meta)?;
        out.put(event.value());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_lease(
    subscriber: *mut conduit_ring_subscriber,
    timeout_ns: u64,
    lease: *mut *mut conduit_ring_lease,
    event: *mut u32,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let event_out = unsafe { Out::new(event, "event") }?;
        // SAFETY: null or writable, by the header.
        let lease_out = unsafe { Out::new(lease, "lease") }?;
        lease_out.put(std::ptr::null_mut());
        // SAFETY: null or a living subscriber, by the header.
        let mut inner = unsafe { lock(subscriber) }?;
        let (event, lease) = inner.in_time(timeout(timeout_ns), Inner::try_lease)?;
        event_out.put(event.value());
        if let Some(lease) = lease {
            lease_out.put(Box::into_raw(Box::new(lease)));
        }
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_wait(
    subscriber: *mut conduit_ring_subscriber,
    timeout_ns: u64,
) -> c_int {
    // SAFETY: null or a living subscriber, by the header.
    answer(|| unsafe { lock(subscriber) }?.wait(timeout(timeout_ns)))
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_await_topic(
    subscriber: *mut conduit_ring_subscriber,
    timeout_ns: u64,
) -> c_int {
    // SAFETY: null or a living subscriber, by the header.
    answer(|| unsafe { lock(subscriber) }?.await_topic(timeout(timeout_ns)))
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_waker(
    subscriber: *mut conduit_ring_subscriber,
    waker: *mut *mut conduit_ring_waker,
) -> c_int {
    answer(|| {
        // SAFETY: null or a living subscriber, by the header.
        let inner = || unsafe { lock(subscriber) };
        let make = || Ok(conduit_ring_waker(inner()?.subscriber.waker()));
        // SAFETY: null or writable, by the header.
        unsafe { Out::handle(waker, "waker", make) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_set_policy(
    subscriber: *mut conduit_ring_subscriber,
    policy: u32,
) -> c_int {
    answer(|| {
        let policy = self::policy(policy)?;
        // SAFETY: null or a living subscriber, by the header.
        unsafe { lock(subscriber) }?.subscriber.set_policy(policy);
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_publisher_up(
    subscriber: *mut conduit_ring_subscriber,
    up: *mut bool,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(up, "up") }?;
        // SAFETY: null or a living subscriber, by the header.
        out.put(unsafe { lock(subscriber) }?.subscriber.publisher_up());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_geometry(
    subscriber: *mut conduit_ring_subscriber,
    geometry: *mut conduit_ring_geometry,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(geometry, "geometry") }?;
        // SAFETY: null or a living subscriber, by the header.
        let inner = unsafe { lock(subscriber) }?;
        let geometry = inner.subscriber.geometry();
        out.put(geometry.ok_or_else(|| inner.no_topic())?.into());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_content_tag(
    subscriber: *mut conduit_ring_subscriber,
    content_tag: *mut u64,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(content_tag, "content_tag") }?;
        // SAFETY: null or a living subscriber, by the header.
        let inner = unsafe { lock(subscriber) }?;
        let content = inner.subscriber.content();
        out.put(content.ok_or_else(|| inner.no_topic())?.value());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_stats(
    subscriber: *mut conduit_ring_subscriber,
    stats: *mut conduit_ring_stats,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(stats, "stats") }?;
        // SAFETY: null or a living subscriber, by the header.
        out.put(unsafe { lock(subscriber) }?.subscriber.stats().into());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_close(
    subscriber: *mut conduit_ring_subscriber,
) -> c_int {
    answer(|| {
        // SAFETY: null or a living subscriber given back, by the header.
        drop(unsafe { pointer::give_back(subscriber) });
        Ok(())
    })
}

/// `timeout_ns` without an end: more than half a millennium.
pub const CONDUIT_RING_FOREVER: u64 = u64::MAX;

fn timeout(timeout_ns: u64) -> Duration {
    Duration::from_nanos(timeout_ns)
}
