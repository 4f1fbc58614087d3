//! What a reader needs of a segment, whether the segment is mapped or not.
//!
//! The reading protocol ([`reader`](crate::reader)), the claims and the inspecting code are
//! written against [`Source`]. A mapping is one source ([`Memory`]); a file that is read by
//! `pread` is another (`Guarded`), for files that another user could shorten at any moment.

use crate::geometry::Geometry;
use crate::layout::{At32, At64, WRITE_IDX};
use crate::memory::{Memory, Slot};
use crate::sync::Ordering;

/// A segment that can be read.
pub(crate) trait Source {
    type Slot<'a>: SourceSlot
    where
        Self: 'a;

    /// Returns the geometry that was checked when the segment was opened.
    fn geometry(&self) -> Geometry;

    /// Loads a 64-bit word of the header. `order` is Relaxed or Acquire.
    fn load(&self, at: At64, order: Ordering) -> u64;

    /// Loads a 32-bit word of the header. `order` is Relaxed or Acquire.
    fn load32(&self, at: At32, order: Ordering) -> u32;

    /// Returns the slot of a message.
    fn slot(&self, sequence: u64) -> Self::Slot<'_>;
}

/// A slot of a [`Source`].
pub(crate) trait SourceSlot {
    /// Loads a word of the slot's header, relaxed.
    fn load(&self, word: usize) -> u32;

    /// Copies the first `len` bytes of the payload to `to`.
    ///
    /// # Safety
    /// `to` is valid for writes of `len` bytes.
    unsafe fn read_payload(&self, to: *mut u8, len: usize);
}

/// Returns how many messages have been published, which is the next sequence number.
#[inline]
pub(crate) fn published(source: &impl Source) -> u64 {
    // Acquire: meets the Release in Writer::use_number, so that the messages before are visible.
    source.load(WRITE_IDX, Ordering::Acquire)
}

impl Source for Memory {
    type Slot<'a> = Slot<'a>;

    #[inline]
    fn geometry(&self) -> Geometry {
        Memory::geometry(self)
    }

    #[inline]
    fn load(&self, at: At64, order: Ordering) -> u64 {
        self.u64(at).load(order)
    }

    #[inline]
    fn load32(&self, at: At32, order: Ordering) -> u32 {
        self.u32(at).load(order)
    }

    #[inline]
    fn slot(&self, sequence: u64) -> Slot<'_> {
        Memory::slot(self, sequence)
    }
}

impl SourceSlot for Slot<'_> {
    #[inline]
    fn load(&self, word: usize) -> u32 {
        Slot::load(self, word)
    }

    #[inline]
    unsafe fn read_payload(&self, to: *mut u8, len: usize) {
        // SAFETY: the caller's promise is the same.
        unsafe { Slot::read_payload(self, to, len) };
    }
}
