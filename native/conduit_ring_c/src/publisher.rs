//! Publishing.

use std::ffi::{c_char, c_int, c_void};
use std::sync::{Mutex, MutexGuard};

use conduit_ring::{Geometry, Publisher, PublisherOptions, SuspendedLoan, Topic};

use crate::errno;
use crate::failure::{Failure, answer};
use crate::geometry::conduit_ring_geometry;
use crate::info::{conduit_ring_info, tag};
use crate::pointer::{self, Out};
use crate::version::{self, CONDUIT_RING_ABI_VERSION};

/// `flags`: replace a file that is not ours although a process may still use it.
pub const CONDUIT_RING_FORCE: u32 = 1;

/// So many parts need no allocation.
const FEW_PARTS: usize = 8;

/// How a topic is published.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct conduit_ring_publisher_options {
    /// The header's.
    pub abi_version: u32,
    /// Bits.
    pub flags: u32,
    /// Number and length of the slots.
    pub geometry: conduit_ring_geometry,
    /// Name of the encoding.
    pub content: *const c_char,
    /// Permissions of the file.
    pub mode: u32,
    /// Group of the file.
    pub group: u32,
}

/// One of several parts of a message; laid out as `struct iovec`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct conduit_ring_part {
    /// Where it begins.
    pub data: *const c_void,
    /// Its length.
    pub size_bytes: usize,
}

/// `group`: the process's own.
pub const CONDUIT_RING_OWN_GROUP: u32 = 0xFFFF_FFFF;

/// Opaque to C. The lock lets several threads share one publisher.
pub(crate) struct conduit_ring_publisher(Mutex<Inner>);

pub(crate) struct Inner {
    /// `None` once it was ended.
    publisher: Option<Publisher>,
    /// While it is out, nothing else is published: its holder writes to the next message's slot.
    loan: Option<SuspendedLoan>,
}

impl conduit_ring_publisher {
    #[inline]
    fn lock(&self) -> Result<MutexGuard<'_, Inner>, Failure> {
        self.0.lock().map_err(|_| Failure::broken("publisher"))
    }
}

fn ended() -> Failure {
    Failure::new(errno::ESHUTDOWN, "this publisher has ended its topic")
}

impl Inner {
    fn publisher(&mut self) -> Result<&mut Publisher, Failure> {
        self.publisher.as_mut().ok_or_else(ended)
    }

    #[inline]
    fn idle(&mut self) -> Result<&mut Publisher, Failure> {
        let publisher = self.publisher.as_mut().ok_or_else(ended)?;
        if self.loan.is_none() {
            Ok(publisher)
        } else {
            Err(Failure::new(
                errno::EALREADY,
                "a loan of this publisher is out; commit or cancel it first",
            ))
        }
    }

    fn lend(&mut self, len: usize) -> Result<*mut u8, Failure> {
        let loan = self.idle()?.loan(len)?.suspend();
        Ok(self.loan.insert(loan).as_mut_ptr())
    }

    fn commit(&mut self, len: usize) -> Result<u64, Failure> {
        let publisher = self.publisher.as_mut().ok_or_else(ended)?;
        let lent = self.loan.as_ref().map(SuspendedLoan::len);
        let lent = lent.ok_or_else(|| Failure::invalid("there is no loan to commit"))?;
        if len > lent {
            return Err(Failure::invalid(format!(
                "{len} bytes cannot be committed of a loan of {lent}"
            )));
        }
        let loan = self.loan.take();
        let mut loan = loan
            .and_then(|loan| loan.resume(publisher))
            .ok_or_else(|| Failure::broken("publisher"))?;
        loan.truncate(len);
        Ok(loan.commit())
    }
}

/// # Safety
/// `options` is null or leads to options whose texts live.
unsafe fn read_options(
    options: *const conduit_ring_publisher_options,
) -> Result<PublisherOptions, Failure> {
    if options.is_null() {
        return Ok(PublisherOptions::default());
    }
    // SAFETY: the version comes first in every version of the options.
    let abi_version = *unsafe { pointer::shared(options.cast::<u32>(), "options") }?;
    version::check(abi_version, "options")?;
    // SAFETY: they are of this version.
    let options = unsafe { pointer::shared(options, "options") }?;
    if options.flags & !CONDUIT_RING_FORCE != 0 {
        let flags = options.flags;
        return Err(Failure::invalid(format!(
            "flags is {flags:#x}; accepted are 0 and CONDUIT_RING_FORCE"
        )));
    }
    Ok(PublisherOptions {
        geometry: Geometry::try_from(options.geometry)?,
        // SAFETY: null or a text, by the caller's promise.
        content: unsafe { tag(options.content) }?,
        mode: options.mode,
        group: (options.group != CONDUIT_RING_OWN_GROUP).then_some(options.group),
        force: options.flags & CONDUIT_RING_FORCE != 0,
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_open(
    topic: *const c_char,
    options: *const conduit_ring_publisher_options,
    publisher: *mut *mut conduit_ring_publisher,
) -> c_int {
    answer(|| {
        let open = || {
            // SAFETY: null or a text, by the header.
            let topic = Topic::new(unsafe { pointer::text(topic, "topic") }?)?;
            // SAFETY: null or options, by the header.
            let options = unsafe { read_options(options) }?;
            let publisher = Publisher::open(&topic, &options)?;
            Ok(conduit_ring_publisher(Mutex::new(Inner {
                publisher: Some(publisher),
                loan: None,
            })))
        };
        // SAFETY: null or writable, by the header.
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
    answer(|| {
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // SAFETY: null or `size_bytes` readable bytes, by the header.
        let message = unsafe { pointer::bytes(data, size_bytes, "data") }?;
        let published = publisher.lock()?.idle()?.publish(message)?;
        // SAFETY: null or writable, by the header.
        unsafe { tell(sequence, published) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_publish_parts(
    publisher: *mut conduit_ring_publisher,
    parts: *const conduit_ring_part,
    part_count: usize,
    sequence: *mut u64,
) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // SAFETY: null or `part_count` readable parts, by the header.
        let parts = unsafe { pointer::array(parts, part_count, "parts") }?;
        // SAFETY: each leads to its bytes, by the header.
        let slice = |part: &conduit_ring_part| unsafe {
            pointer::bytes(part.data, part.size_bytes, "data of a part")
        };
        let published = if parts.len() <= FEW_PARTS {
            let mut few: [&[u8]; FEW_PARTS] = [&[]; FEW_PARTS];
            for (to, part) in few.iter_mut().zip(parts) {
                *to = slice(part)?;
            }
            publisher
                .lock()?
                .idle()?
                .publish_slices(&few[..parts.len()])?
        } else {
            let many: Vec<&[u8]> = parts.iter().map(slice).collect::<Result<_, _>>()?;
            publisher.lock()?.idle()?.publish_slices(&many)?
        };
        // SAFETY: null or writable, by the header.
        unsafe { tell(sequence, published) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_loan(
    publisher: *mut conduit_ring_publisher,
    size_bytes: usize,
    data: *mut *mut c_void,
) -> c_int {
    answer(|| {
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(data, "data") }?;
        out.put(std::ptr::null_mut());
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        out.put(publisher.lock()?.lend(size_bytes)?.cast());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_commit(
    publisher: *mut conduit_ring_publisher,
    size_bytes: usize,
    sequence: *mut u64,
) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        let published = publisher.lock()?.commit(size_bytes)?;
        // SAFETY: null or writable, by the header.
        unsafe { tell(sequence, published) }
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_cancel(
    publisher: *mut conduit_ring_publisher,
) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        publisher.lock()?.loan = None;
        Ok(())
    })
}

/// # Safety
/// `to` is null or writable.
#[inline]
unsafe fn tell(to: *mut u64, sequence: u64) -> Result<(), Failure> {
    if !to.is_null() {
        // SAFETY: the caller's promise is the same.
        unsafe { Out::new(to, "sequence") }?.put(sequence);
    }
    Ok(())
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_info(
    publisher: *mut conduit_ring_publisher,
    info: *mut conduit_ring_info,
) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // SAFETY: null or writable, by the header.
        let out = unsafe { Out::new(info, "info") }?;
        out.put((&publisher.lock()?.publisher()?.info()).into());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_end(publisher: *mut conduit_ring_publisher) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // What was lent stays mapped.
        publisher.lock()?.publisher = None;
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_close(publisher: *mut conduit_ring_publisher) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher given back, by the header.
        drop(unsafe { pointer::give_back(publisher) });
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_abandon(
    publisher: *mut conduit_ring_publisher,
) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher given back, by the header.
        let publisher = unsafe { pointer::give_back(publisher) };
        if let Some(conduit_ring_publisher(publisher)) = publisher {
            let inner = publisher.into_inner();
            let inner = inner.unwrap_or_else(|poisoned| poisoned.into_inner());
            if let Some(publisher) = inner.publisher {
                publisher.abandon();
            }
        }
        Ok(())
    })
}

const _: () = assert!(CONDUIT_RING_ABI_VERSION != 0, "zeroed options are refused");
