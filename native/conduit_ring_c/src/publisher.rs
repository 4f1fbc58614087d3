//! The functions of a publisher.

use std::ffi::{c_char, c_int, c_void};

use conduit_ring::{Publisher, Topic};

use crate::failure::{Failure, status};
use crate::info::conduit_ring_info;
use crate::pointer::{self, Out};
use crate::publication::conduit_ring_publisher;
use crate::publisher_options::{self, conduit_ring_publisher_options};

/// The most parts that need no allocation.
const FEW_PARTS: usize = 8;

/// One part of a message, with the layout of `struct iovec`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct conduit_ring_part {
    /// The part's bytes.
    pub data: *const c_void,
    /// The part's size.
    pub size_bytes: usize,
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_open(
    topic: *const c_char,
    options: *const conduit_ring_publisher_options,
    publisher: *mut *mut conduit_ring_publisher,
) -> c_int {
    status(|| {
        let open = || {
            // SAFETY: null or a NUL-terminated text, as the header demands.
            let topic = Topic::new(unsafe { pointer::text(topic, "topic") }?)?;
            // SAFETY: null or options, as the header demands.
            let (options, own_thread) = unsafe { publisher_options::read(options) }?;
            Publisher::open(&topic, &options)
                .map(|publisher| conduit_ring_publisher::new(publisher, own_thread))
                .map_err(Failure::from)
        };
        // SAFETY: null or writable, as the header demands.
        unsafe { Out::handle(publisher, "publisher", open) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_publish(
    publisher: *mut conduit_ring_publisher,
    data: *const c_void,
    size_bytes: usize,
    sequence: *mut u64,
) -> c_int {
    status(|| {
        // SAFETY: null or an open publisher, as the header demands.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // SAFETY: null or `size_bytes` readable bytes, as the header demands.
        let message = unsafe { pointer::bytes(data, size_bytes, "data") }?;
        let published = publisher.lock()?.publish(&[message])?;
        // SAFETY: null or writable, as the header demands.
        unsafe { put_sequence(sequence, published) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_publish_parts(
    publisher: *mut conduit_ring_publisher,
    parts: *const conduit_ring_part,
    part_count: usize,
    sequence: *mut u64,
) -> c_int {
    status(|| {
        // SAFETY: null or an open publisher, as the header demands.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // SAFETY: null or `part_count` readable parts, as the header demands.
        let parts = unsafe { pointer::array(parts, part_count, "parts") }?;
        // SAFETY: each leads to its bytes, as the header demands.
        let slice = |part: &conduit_ring_part| unsafe {
            pointer::bytes(part.data, part.size_bytes, "data of a part")
        };
        let published = if parts.len() <= FEW_PARTS {
            let mut few: [&[u8]; FEW_PARTS] = [&[]; FEW_PARTS];
            for (to, part) in few.iter_mut().zip(parts) {
                *to = slice(part)?;
            }
            publisher.lock()?.publish(&few[..parts.len()])?
        } else {
            let many: Vec<&[u8]> = parts.iter().map(slice).collect::<Result<_, _>>()?;
            publisher.lock()?.publish(&many)?
        };
        // SAFETY: null or writable, as the header demands.
        unsafe { put_sequence(sequence, published) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_loan(
    publisher: *mut conduit_ring_publisher,
    size_bytes: usize,
    data: *mut *mut c_void,
) -> c_int {
    status(|| {
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(data, "data") }?;
        out.put(std::ptr::null_mut());
        // SAFETY: null or an open publisher, as the header demands.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        out.put(publisher.lock()?.loan(size_bytes)?.cast());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_commit(
    publisher: *mut conduit_ring_publisher,
    size_bytes: usize,
    sequence: *mut u64,
) -> c_int {
    status(|| {
        // SAFETY: null or an open publisher, as the header demands.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        let published = publisher.lock()?.commit(size_bytes)?;
        // SAFETY: null or writable, as the header demands.
        unsafe { put_sequence(sequence, published) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_cancel(
    publisher: *mut conduit_ring_publisher,
) -> c_int {
    status(|| {
        // SAFETY: null or an open publisher, as the header demands.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        publisher.lock()?.cancel_loan();
        Ok(())
    })
}

/// Writes a sequence number unless the caller passed null.
///
/// # Safety
/// `to` is null or writable.
#[inline]
unsafe fn put_sequence(to: *mut u64, sequence: u64) -> Result<(), Failure> {
    if !to.is_null() {
        // SAFETY: the caller guarantees the same.
        unsafe { Out::new(to, "sequence") }?.put(sequence);
    }
    Ok(())
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_info(
    publisher: *mut conduit_ring_publisher,
    info: *mut conduit_ring_info,
) -> c_int {
    status(|| {
        // SAFETY: null or an open publisher, as the header demands.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // SAFETY: null or writable, as the header demands.
        let out = unsafe { Out::new(info, "info") }?;
        out.put((&publisher.lock()?.publisher()?.info()).into());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_look_after(
    publisher: *mut conduit_ring_publisher,
) -> c_int {
    status(|| {
        // SAFETY: null or an open publisher, as the header demands.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        let mut inner = publisher.lock()?;
        let checked = inner.without_loan()?.look_after();
        inner.explain(checked)
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_end(publisher: *mut conduit_ring_publisher) -> c_int {
    status(|| {
        // SAFETY: null or an open publisher, as the header demands.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // An outstanding loan stays mapped.
        drop(publisher.take());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_close(
    publisher: *mut conduit_ring_publisher,
) -> c_int {
    status(|| {
        // SAFETY: null or a publisher that was not closed, as the header demands.
        let publisher = unsafe { pointer::take(publisher) };
        drop(publisher.and_then(|publisher| publisher.take()));
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_abandon(
    publisher: *mut conduit_ring_publisher,
) -> c_int {
    status(|| {
        // SAFETY: null or a publisher that was not closed, as the header demands.
        let publisher = unsafe { pointer::take(publisher) };
        if let Some(publisher) = publisher.and_then(|publisher| publisher.take()) {
            publisher.abandon();
        }
        Ok(())
    })
}
