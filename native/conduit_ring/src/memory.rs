//! A mapped segment as the protocol sees it: words at offsets, slots by sequence number, one
//! futex.
//!
//! The protocol is written against this type alone. `memory_model.rs` is its twin for loom, with
//! the same functions over loom's atomics.

use std::time::Duration;

use crate::copy;
use crate::geometry::Geometry;
use crate::layout::{At32, At64, FUTEX_WORD, SLOT_HEADER_LEN};
use crate::os::{self, Mapping};
use crate::sync::{AtomicU32, AtomicU64};

/// A mapping that is long enough for its geometry.
///
/// It upholds the invariant of all `unsafe` blocks in this file: every word and every slot that
/// it hands out lies inside the mapping.
pub(crate) struct Memory {
    mapping: Mapping,
    geometry: Geometry,
}

impl Memory {
    /// Returns `None` when the mapping is shorter than the geometry needs.
    pub(crate) fn new(mapping: Mapping, geometry: Geometry) -> Option<Memory> {
        (mapping.len() as u64 >= geometry.segment_len()).then_some(Memory { mapping, geometry })
    }

    #[inline]
    pub(crate) fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// Returns a 32-bit word of the header.
    #[inline]
    pub(crate) fn u32(&self, at: At32) -> &AtomicU32 {
        let word = self.mapping.base().wrapping_add(at.offset()).cast();
        // SAFETY: an At32 is 4-aligned and inside the header; the mapping is page-aligned, holds
        // a header and lives as long as self; other processes touch this word with atomic
        // instructions too.
        unsafe { AtomicU32::from_ptr(word) }
    }

    /// Returns a 64-bit word of the header.
    #[inline]
    pub(crate) fn u64(&self, at: At64) -> &AtomicU64 {
        let word = self.mapping.base().wrapping_add(at.offset()).cast();
        // SAFETY: as for u32, with an alignment of 8.
        unsafe { AtomicU64::from_ptr(word) }
    }

    /// Returns the slot of a message.
    #[inline]
    pub(crate) fn slot(&self, sequence: u64) -> Slot<'_> {
        let base = self
            .mapping
            .base()
            .wrapping_add(self.geometry.slot_offset(sequence));
        Slot { base, memory: self }
    }

    /// Sleeps while the futex word is `expected`, at most for `timeout`. May return early for no
    /// reason.
    pub(crate) fn futex_wait(&self, expected: u32, timeout: Duration) {
        os::futex_wait(self.u32(FUTEX_WORD), expected, timeout);
    }

    /// Wakes every sleeper of every process and returns how many there were.
    pub(crate) fn futex_wake(&self) -> u32 {
        os::futex_wake_all(self.u32(FUTEX_WORD))
    }
}

/// One slot of a [`Memory`].
///
/// All accesses are relaxed atomics, so that they are defined beside a writer of another process.
/// They go byte by byte where a legacy publisher's slot size leaves words unaligned. Their order
/// comes from the fences of `writer` and `reader`.
#[derive(Clone, Copy)]
pub(crate) struct Slot<'a> {
    base: *mut u8,
    memory: &'a Memory,
}

impl Slot<'_> {
    /// Loads a word of the slot's header.
    #[inline]
    pub(crate) fn load(&self, word: usize) -> u32 {
        let mut value = [0; 4];
        // SAFETY: `word` is one of layout's offsets into a slot's header, and slots lie inside
        // the mapping.
        unsafe { copy::out_of_shared(self.base.wrapping_add(word), value.as_mut_ptr(), 4) };
        u32::from_le_bytes(value)
    }

    /// Stores a word of the slot's header.
    #[inline]
    pub(crate) fn store(&self, word: usize, value: u32) {
        let value = value.to_le_bytes();
        // SAFETY: as for load.
        unsafe { copy::into_shared(value.as_ptr(), self.base.wrapping_add(word), 4) };
    }

    /// Copies `part` into the payload, `at` bytes from its start.
    ///
    /// # Panics
    /// Panics if it does not fit.
    #[inline]
    pub(crate) fn write_payload(&self, at: usize, part: &[u8]) {
        assert!(at <= self.room() && part.len() <= self.room() - at);
        let to = self.base.wrapping_add(SLOT_HEADER_LEN + at);
        // SAFETY: the destination lies inside this slot by the assertion, the source is a slice
        // of this process.
        unsafe { copy::into_shared(part.as_ptr(), to, part.len()) };
    }

    /// Returns the address of the payload. The slot has room for the longest message there.
    pub(crate) fn payload(&self) -> *mut u8 {
        self.base.wrapping_add(SLOT_HEADER_LEN)
    }

    /// Copies the first `len` bytes of the payload to `to`.
    ///
    /// # Panics
    /// Panics if the slot is shorter.
    ///
    /// # Safety
    /// `to` is valid for writes of `len` bytes.
    #[inline]
    pub(crate) unsafe fn read_payload(&self, to: *mut u8, len: usize) {
        assert!(len <= self.room());
        let from = self.base.wrapping_add(SLOT_HEADER_LEN);
        // SAFETY: the source lies inside this slot by the assertion, the destination has room by
        // the caller's promise.
        unsafe { copy::out_of_shared(from, to, len) };
    }

    #[inline]
    fn room(&self) -> usize {
        self.memory.geometry.capacity()
    }
}
