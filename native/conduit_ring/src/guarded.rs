//! Reading a segment that others may shorten at any time.
//!
//! A user who may write a file may also shorten it, and a process that then touches a mapping
//! behind the end gets SIGBUS. So a guarded reader touches no mapping. It reads every word and
//! every byte by `pread`, for which the end of the file is an answer.
//!
//! | file | words and payloads | sleep | reader slot |
//! |---|---|---|---|
//! | of a stranger, or legacy | `pread` | naps of 1 to 4 ms | none |
//! | of a trusted user | `pread` | futex, by the kernel | its lock only |
//!
//! A stranger's file is not even mapped. A trusted user's file is mapped, but only the kernel
//! touches the mapping, to sleep on the futex word and to set the waiting bit (`FUTEX_WAKE_OP`);
//! it returns EFAULT for a page that does not exist.
//!
//! A guarded reader writes nothing but that bit. It holds the lock of a reader slot, so that the
//! bit is its own. It sets no other bit, and so does not show among the topic's readers.

use std::io;
use std::sync::OnceLock;
use std::time::Duration;

use crate::attach::bad;
use crate::error::{Error, Fault};
use crate::geometry::Geometry;
use crate::header::Header;
use crate::layout::{
    At32, At64, FUTEX_WORD, ReaderSlot, SLOT_HEADER_LEN, SUBSCRIBER_MASK, WAITING_MASK,
};
use crate::os::{Access, Mapping, Segment, is_missing_page};
use crate::source::{Source, SourceSlot};
use crate::sync::{Ordering, fence};
use crate::topic::Topic;
use crate::wait::LONGEST_SLEEP;
use crate::waker::Alarm;

/// A segment that is read by `pread`: see the module.
pub(crate) struct Guarded {
    pub(crate) segment: Segment,
    pub(crate) header: Header,
    /// `None` for a stranger's file, and for a legacy publisher's, which has no waiting bits.
    mapping: Option<Mapping>,
    /// `None` for an observer, and without a mapping.
    reader_slot: Option<ReaderSlot>,
    /// The first failure of a system call.
    broken: OnceLock<io::Error>,
}

impl Guarded {
    /// Makes a segment that is read by `pread` alone.
    pub(crate) fn unmapped(segment: Segment, header: Header) -> Guarded {
        Guarded {
            segment,
            header,
            mapping: None,
            reader_slot: None,
            broken: OnceLock::new(),
        }
    }

    /// Makes a segment whose mapping the kernel may touch.
    pub(crate) fn open(
        topic: &Topic,
        segment: Segment,
        header: Header,
        access: Access,
    ) -> Result<Guarded, Error> {
        let mapping = segment
            .map(header.geometry.segment_len(), access, false)
            .map_err(Error::os("map", topic.path()))?;
        let mut guarded = Guarded::unmapped(segment, header);
        guarded.mapping = Some(mapping);
        if access == Access::Write {
            guarded.reader_slot = guarded
                .lock_reader_slot()
                .map_err(Error::os("lock", topic.path()))?;
            if guarded.reader_slot.is_none() {
                let path = topic.path().to_owned();
                return Err(Error::NoReaderSlot { path });
            }
        }
        Ok(guarded)
    }

    /// Locks a reader slot that no reader has claimed.
    fn lock_reader_slot(&self) -> io::Result<Option<ReaderSlot>> {
        for reader_slot in ReaderSlot::all() {
            let claimed = self.load32(SUBSCRIBER_MASK) & reader_slot.bit() != 0;
            if !claimed && self.segment.try_lock(reader_slot.lock())? {
                return Ok(Some(reader_slot));
            }
        }
        Ok(None)
    }

    /// Returns an error once the file has turned out to be shorter than it was, or unreadable.
    pub(crate) fn check(&self, topic: &Topic) -> Result<(), Error> {
        match self.broken.get() {
            None => Ok(()),
            Some(error) => Err(match error.raw_os_error() {
                Some(errno) if !is_missing_page(error) => {
                    Error::os("read", topic.path())(io::Error::from_raw_os_error(errno))
                }
                _ => bad(topic, Fault::Truncated),
            }),
        }
    }

    pub(crate) fn is_broken(&self) -> bool {
        self.broken.get().is_some()
    }

    pub(crate) fn load32(&self, at: At32) -> u32 {
        u32::from_le_bytes(self.bytes(at.offset()))
    }

    pub(crate) fn is_mapped(&self) -> bool {
        self.mapping.is_some()
    }

    /// As `wait::sleep`, with the kernel's hands. Without a mapping it returns at once.
    pub(crate) fn sleep(&self, timeout: Duration, news: impl FnOnce() -> bool) {
        let Some(mapping) = &self.mapping else {
            return;
        };
        let seen = self.load32(FUTEX_WORD);
        // Acquire: as in wait::sleep; the word was read by the kernel for this thread.
        fence(Ordering::Acquire);
        if let Some(reader_slot) = self.reader_slot {
            self.record(mapping.set_bit(WAITING_MASK.offset(), reader_slot.index()));
        }
        // SeqCst: as in wait::sleep.
        fence(Ordering::SeqCst);
        if !news() && !self.is_broken() {
            let timeout = timeout.min(LONGEST_SLEEP);
            self.record(mapping.futex_wait(FUTEX_WORD.offset(), seen, timeout));
        }
        self.stop_waiting();
    }

    fn stop_waiting(&self) {
        if let (Some(reader_slot), Some(mapping)) = (self.reader_slot, &self.mapping) {
            self.record(mapping.clear_bit(WAITING_MASK.offset(), reader_slot.index()));
        }
    }

    fn bytes<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut bytes = [0; N];
        self.record(self.segment.read_at(&mut bytes, offset as u64));
        bytes
    }

    /// Remembers a failure. The caller of `check` gets it.
    fn record(&self, result: io::Result<()>) {
        if let Err(error) = result {
            // The first failure is the one that is reported.
            let _ = self.broken.set(error);
        }
    }
}

impl Source for Guarded {
    type Slot<'a> = GuardedSlot<'a>;

    fn geometry(&self) -> Geometry {
        self.header.geometry
    }

    /// A word may change while the kernel copies it. So it is read until two reads are equal.
    fn load(&self, at: At64, _order: Ordering) -> u64 {
        let mut last: [u8; 8] = self.bytes(at.offset());
        loop {
            let now = self.bytes(at.offset());
            if now == last || self.is_broken() {
                // Acquire, whatever was asked for. A fence also orders the kernel's reads for
                // this thread.
                fence(Ordering::Acquire);
                return u64::from_le_bytes(now);
            }
            last = now;
        }
    }

    fn load32(&self, at: At32, _order: Ordering) -> u32 {
        let word = Guarded::load32(self, at);
        // Acquire, whatever was asked for.
        fence(Ordering::Acquire);
        word
    }

    fn slot(&self, sequence: u64) -> GuardedSlot<'_> {
        GuardedSlot {
            guarded: self,
            offset: self.geometry().slot_offset(sequence),
        }
    }
}

/// A slot that is read by `pread`.
pub(crate) struct GuardedSlot<'a> {
    guarded: &'a Guarded,
    offset: usize,
}

impl SourceSlot for GuardedSlot<'_> {
    fn load(&self, word: usize) -> u32 {
        u32::from_le_bytes(self.guarded.bytes(self.offset + word))
    }

    unsafe fn read_payload(&self, to: *mut u8, len: usize) {
        assert!(len <= self.guarded.geometry().capacity());
        let offset = (self.offset + SLOT_HEADER_LEN) as u64;
        // SAFETY: `to` has room for `len` bytes by the caller's promise.
        self.guarded
            .record(unsafe { self.guarded.segment.read_raw_at(to, len, offset) });
    }
}

impl Alarm for Guarded {
    fn ring(&self) {
        if let Some(mapping) = &self.mapping {
            self.record(mapping.bump_and_wake(FUTEX_WORD.offset()));
        }
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        if let Some(reader_slot) = self.reader_slot {
            self.stop_waiting();
            // The mapping may keep the open file, and so the lock.
            let _ = self.segment.unlock(reader_slot.lock());
        }
    }
}
