//! Publishing.

use std::ffi::{c_char, c_int, c_void};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use conduit_ring::{
    Geometry, Owner, PublishError, Publisher, PublisherOptions, SuspendedLoan, Topic,
    upkeep::Upkeep,
};

use crate::errno;
use crate::failure::{Failure, answer};
use crate::geometry::conduit_ring_geometry;
use crate::info::{conduit_ring_info, tag};
use crate::pointer::{self, Out};
use crate::version::{self, CONDUIT_RING_ABI_VERSION};

/// `flags`: replace a file that is not ours although a process may still use it.
pub const CONDUIT_RING_FORCE: u32 = 1;

/// `flags`: no thread looks after the topic's name; the caller does.
pub const CONDUIT_RING_NO_THREAD: u32 = 2;

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

/// Opaque to C.
pub(crate) struct conduit_ring_publisher {
    /// The thread that looks after the topic's name, if there is one. It ends first.
    _upkeep: Option<Upkeep>,
    shared: Arc<Shared>,
}

/// What the handle shares with the thread that looks after the topic's name. The lock lets several threads publish.
pub(crate) struct Shared {
    inner: Mutex<Inner>,
    owner: Owner,
}

pub(crate) struct Inner {
    /// `None` once it was ended.
    publisher: Option<Publisher>,
    /// While it is out, nothing else is published: its holder writes to the next message's slot.
    loan: Option<SuspendedLoan>,
    /// The next message's number at the last look after the name.
    seen: Option<u64>,
}

impl conduit_ring_publisher {
    fn new(publisher: Publisher, own_thread: bool) -> conduit_ring_publisher {
        let shared = Arc::new(Shared {
            inner: Mutex::new(Inner {
                publisher: Some(publisher),
                loan: None,
                seen: None,
            }),
            owner: Owner::here(),
        });
        let watched = shared.clone();
        let upkeep = own_thread.then(|| Upkeep::start(move || watched.look()));
        conduit_ring_publisher {
            _upkeep: upkeep.and_then(Result::ok),
            shared,
        }
    }

    #[inline]
    fn lock(&self) -> Result<MutexGuard<'_, Inner>, Failure> {
        if !self.shared.owner.is_here() {
            return Err(PublishError::Forked.into());
        }
        let inner = self.shared.inner.lock();
        inner.map_err(|_| Failure::broken("publisher"))
    }

    /// The publisher, to be ended; `None` in a child of the process that opened it, too.
    fn take(&self) -> Option<Publisher> {
        if !self.shared.owner.is_here() {
            return None;
        }
        let inner = self.shared.inner.lock();
        inner
            .unwrap_or_else(PoisonError::into_inner)
            .publisher
            .take()
    }
}

impl Shared {
    /// Looks after the topic's name; `false` when there is nothing to look after any more.
    fn look(&self) -> bool {
        match self.inner.try_lock() {
            Ok(mut inner) => inner.look(),
            // It publishes just now, and looks by itself.
            Err(TryLockError::WouldBlock) => true,
            Err(TryLockError::Poisoned(_)) => false,
        }
    }
}

fn ended() -> Failure {
    Failure::new(errno::ESHUTDOWN, "this publisher has ended its topic")
}

impl Inner {
    fn publisher(&mut self) -> Result<&mut Publisher, Failure> {
        self.publisher.as_mut().ok_or_else(ended)
    }

    fn look(&mut self) -> bool {
        let Some(publisher) = &mut self.publisher else {
            return false;
        };
        let next = Some(publisher.next_sequence());
        // One that publishes looks by itself; a loan is written to the file that there is.
        if self.loan.is_none() && self.seen == next {
            // Whoever publishes is told; and it is tried again.
            let _ = publisher.look_after();
        }
        self.seen = next;
        true
    }

    /// What became of a message, with the reason where the name is lost.
    fn say<T>(&self, done: Result<T, PublishError>) -> Result<T, Failure> {
        let trouble = self.publisher.as_ref().and_then(Publisher::trouble);
        done.map_err(|error| match (error, trouble) {
            (PublishError::NameLost, Some(trouble)) => {
                Failure::new(errno::ESTALE, format!("{error}: {trouble}"))
            }
            _ => error.into(),
        })
    }

    #[inline]
    fn publish(&mut self, parts: &[&[u8]]) -> Result<u64, Failure> {
        let published = self.idle()?.publish_slices(parts);
        self.say(published)
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
        let lent = self.idle()?.loan(len).map(|loan| loan.suspend());
        let loan = self.say(lent)?;
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

/// The options, and whether a thread looks after the topic's name.
///
/// # Safety
/// `options` is null or leads to options whose texts live.
unsafe fn read_options(
    options: *const conduit_ring_publisher_options,
) -> Result<(PublisherOptions, bool), Failure> {
    if options.is_null() {
        return Ok((PublisherOptions::default(), true));
    }
    // SAFETY: the version comes first in every version of the options.
    let abi_version = *unsafe { pointer::shared(options.cast::<u32>(), "options") }?;
    version::check(abi_version, "options")?;
    // SAFETY: they are of this version.
    let options = unsafe { pointer::shared(options, "options") }?;
    if options.flags & !(CONDUIT_RING_FORCE | CONDUIT_RING_NO_THREAD) != 0 {
        let flags = options.flags;
        return Err(Failure::invalid(format!(
            "flags is {flags:#x}; accepted are 0, CONDUIT_RING_FORCE, CONDUIT_RING_NO_THREAD and both"
        )));
    }
    let own_thread = options.flags & CONDUIT_RING_NO_THREAD == 0;
    let options = PublisherOptions {
        geometry: Geometry::try_from(options.geometry)?,
        // SAFETY: null or a text, by the caller's promise.
        content: unsafe { tag(options.content) }?,
        mode: options.mode,
        group: (options.group != CONDUIT_RING_OWN_GROUP).then_some(options.group),
        force: options.flags & CONDUIT_RING_FORCE != 0,
    };
    Ok((options, own_thread))
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
            let (options, own_thread) = unsafe { read_options(options) }?;
            Publisher::open(&topic, &options)
                .map(|publisher| conduit_ring_publisher::new(publisher, own_thread))
                .map_err(Failure::from)
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
        let published = publisher.lock()?.publish(&[message])?;
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
            publisher.lock()?.publish(&few[..parts.len()])?
        } else {
            let many: Vec<&[u8]> = parts.iter().map(slice).collect::<Result<_, _>>()?;
            publisher.lock()?.publish(&many)?
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
unsafe extern "C" fn conduit_ring_publisher_look_after(
    publisher: *mut conduit_ring_publisher,
) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        let mut inner = publisher.lock()?;
        let looked = inner.idle()?.look_after();
        inner.say(looked)
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_end(publisher: *mut conduit_ring_publisher) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher, by the header.
        let publisher = unsafe { pointer::shared(publisher, "publisher") }?;
        // What was lent stays mapped.
        drop(publisher.take());
        Ok(())
    })
}

#[unsafe(no_mangle)]
unsafe extern "C" fn conduit_ring_publisher_close(publisher: *mut conduit_ring_publisher) -> c_int {
    answer(|| {
        // SAFETY: null or a living publisher given back, by the header.
        let publisher = unsafe { pointer::give_back(publisher) };
        drop(publisher.and_then(|publisher| publisher.take()));
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
        if let Some(publisher) = publisher.and_then(|publisher| publisher.take()) {
            publisher.abandon();
        }
        Ok(())
    })
}

const _: () = assert!(CONDUIT_RING_ABI_VERSION != 0, "zeroed options are refused");
