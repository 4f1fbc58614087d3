//! The functions of a subscriber.

use std::ffi::{c_char, c_int, c_void};
use std::time::Duration;

use conduit_ring::{Stats, Subscriber, Topic};

use crate::caller_buffer::CallerBuffer;
use crate::failure::status;
use crate::geometry::conduit_ring_geometry;
use crate::lease::conduit_ring_lease;
use crate::message::{conduit_ring_message, conduit_ring_meta};
use crate::pointer::{self, Out};
use crate::subscriber_options::{self, conduit_ring_subscriber_options};
use crate::subscription::{Inner, conduit_ring_subscriber, lock};
use crate::waker::conduit_ring_waker;

/// The counters of a subscriber since it was opened.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct conduit_ring_stats {
    /// Delivered messages.
    pub delivered: u64,
    /// Lost messages.
    pub lost: u64,
    /// How often the publisher's count was behind the reader's.
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

/// `timeout_ns`: no timeout, since it is more than 500 years.
pub const CONDUIT_RING_FOREVER: u64 = u64::MAX;

fn timeout(timeout_ns: u64) -> Duration {
    Duration::from_nanos(timeout_ns)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_open(
    topic: *const c_char,
    options: *const conduit_ring_subscriber_options,
    subscriber: *mut *mut conduit_ring_subscriber,
) -> c_int {
    status(|| {
        let open = || {
            // SAFETY: null or a NUL-terminated text, as the header demands.
            let topic = Topic::found(unsafe { pointer::text(topic, "topic") }?)?;
            // SAFETY: null or options, as the header demands.
            let options = unsafe { subscriber_options::read(options) }?;
            let subscriber = Subscriber::open(&topic, &options)?;
            Ok(conduit_ring_subscriber::new(subscriber))
        };
        // SAFETY: null or writable, as the header demands.
        unsafe { Out::handle(subscriber, "subscriber", open) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_try_read(
    subscriber: *mut conduit_ring_subscriber,
    message: *mut conduit_ring_message,
    event: *mut u32,
) -> c_int {
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(event, "event") }?;
        // SAFETY: null or a message of the caller, as the header demands.
        let message = unsafe { pointer::exclusive(message, "message") }?;
        // SAFETY: null or an open subscriber, as the header demands.
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
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(event, "event") }?;
        // SAFETY: null or a message of the caller, as the header demands.
        let message = unsafe { pointer::exclusive(message, "message") }?;
        // SAFETY: null or an open subscriber, as the header demands.
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
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(event, "event") }?;
        // SAFETY: null or writable, as the header demands.
        let meta = unsafe { Out::new(meta, "meta") }?;
        // SAFETY: null or that many bytes of the caller, as the header demands.
        let buffer = unsafe { CallerBuffer::new(buffer, capacity_bytes) }?;
        // SAFETY: null or an open subscriber, as the header demands.
        let event = unsafe { lock(subscriber) }?.try_read_into(buffer, &meta)?;
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
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let event_out = unsafe { Out::new(event, "event") }?;
        // SAFETY: null or writable, as the header demands.
        let lease_out = unsafe { Out::new(lease, "lease") }?;
        lease_out.put(std::ptr::null_mut());
        // SAFETY: null or an open subscriber, as the header demands.
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
    // SAFETY: null or an open subscriber, as the header demands.
    status(|| unsafe { lock(subscriber) }?.wait(timeout(timeout_ns)))
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_await_topic(
    subscriber: *mut conduit_ring_subscriber,
    timeout_ns: u64,
) -> c_int {
    // SAFETY: null or an open subscriber, as the header demands.
    status(|| unsafe { lock(subscriber) }?.await_topic(timeout(timeout_ns)))
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_waker(
    subscriber: *mut conduit_ring_subscriber,
    waker: *mut *mut conduit_ring_waker,
) -> c_int {
    status(|| {
        // SAFETY: null or an open subscriber, as the header demands.
        let inner = || unsafe { lock(subscriber) };
        let create = || Ok(conduit_ring_waker(inner()?.subscriber.waker()));
        // SAFETY: null or writable, as the header demands.
        unsafe { Out::handle(waker, "waker", create) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_set_policy(
    subscriber: *mut conduit_ring_subscriber,
    policy: u32,
) -> c_int {
    status(|| {
        let policy = subscriber_options::policy(policy)?;
        // SAFETY: null or an open subscriber, as the header demands.
        unsafe { lock(subscriber) }?.subscriber.set_policy(policy);
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_publisher_up(
    subscriber: *mut conduit_ring_subscriber,
    up: *mut bool,
) -> c_int {
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(up, "up") }?;
        // SAFETY: null or an open subscriber, as the header demands.
        out.put(unsafe { lock(subscriber) }?.subscriber.publisher_up());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_geometry(
    subscriber: *mut conduit_ring_subscriber,
    geometry: *mut conduit_ring_geometry,
) -> c_int {
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(geometry, "geometry") }?;
        // SAFETY: null or an open subscriber, as the header demands.
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
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(content_tag, "content_tag") }?;
        // SAFETY: null or an open subscriber, as the header demands.
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
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(stats, "stats") }?;
        // SAFETY: null or an open subscriber, as the header demands.
        out.put(unsafe { lock(subscriber) }?.subscriber.stats().into());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_subscriber_close(
    subscriber: *mut conduit_ring_subscriber,
) -> c_int {
    status(|| {
        // SAFETY: null or a subscriber that was not closed, as the header demands.
        drop(unsafe { pointer::take(subscriber) });
        Ok(())
    })
}
