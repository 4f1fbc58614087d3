//! The twin of `memory.rs` for loom: the same words and slots as loom's atomics, and a futex that
//! cannot time out, so that a lost wake-up is a deadlock, which loom reports.

use std::collections::BTreeMap;
use std::time::Duration;

use loom::sync::{Condvar, Mutex};

use crate::geometry::Geometry;
use crate::layout::{self, At32, At64, FUTEX_WORD, ReaderSlot, SLOT_HEADER_LEN};
use crate::sync::{AtomicU32, AtomicU64, Ordering, fence};

/// A segment of tiny slots: 24 bytes hold one word of payload.
pub(crate) struct Memory {
    geometry: Geometry,
    words: BTreeMap<usize, AtomicU32>,
    longs: BTreeMap<usize, AtomicU64>,
    slots: Vec<AtomicU32>,
    sleepers: Mutex<u32>,
    alarm: Condvar,
}

impl Memory {
    pub(crate) fn new(geometry: Geometry) -> Memory {
        let words = [
            layout::FUTEX_WORD,
            layout::SUBSCRIBER_MASK,
            layout::NATIVE_MASK,
            layout::WAITING_MASK,
            layout::PIN_MASK,
        ];
        let longs = [
            layout::WRITE_IDX,
            layout::WRITE_INTENT,
            layout::LAST_PUBLISH,
            layout::WAKE_COUNT,
            layout::DROPPED_PINNED,
        ];
        let reader_slots = ReaderSlot::all().flat_map(|reader_slot| {
            let [a, b, c] = reader_slot.pins();
            [
                reader_slot.read_idx(),
                reader_slot.start_time(),
                reader_slot.lost_count(),
                reader_slot.claim_id(),
                a,
                b,
                c,
            ]
        });
        let pids = ReaderSlot::all().map(ReaderSlot::pid);
        let slot_words = (geometry.slot_count() * geometry.slot_size() / 4) as usize;
        Memory {
            geometry,
            words: words
                .into_iter()
                .chain(pids)
                .map(|at| (at.offset(), AtomicU32::new(0)))
                .collect(),
            longs: longs
                .into_iter()
                .chain(reader_slots)
                .map(|at| (at.offset(), AtomicU64::new(0)))
                .collect(),
            slots: (0..slot_words).map(|_| AtomicU32::new(0)).collect(),
            sleepers: Mutex::new(0),
            alarm: Condvar::new(),
        }
    }

    pub(crate) fn geometry(&self) -> Geometry {
        self.geometry
    }

    pub(crate) fn u32(&self, at: At32) -> &AtomicU32 {
        &self.words[&at.offset()]
    }

    pub(crate) fn u64(&self, at: At64) -> &AtomicU64 {
        &self.longs[&at.offset()]
    }

    pub(crate) fn slot(&self, sequence: u64) -> Slot<'_> {
        let first = (self.geometry.slot_offset(sequence) - layout::HEADER_LEN) / 4;
        Slot {
            words: &self.slots[first..first + self.geometry.slot_size() as usize / 4],
        }
    }

    /// As the kernel does, it compares behind a full barrier, with its queue locked.
    pub(crate) fn futex_wait(&self, expected: u32, _timeout: Duration) {
        let mut sleepers = self.sleepers.lock().unwrap();
        fence(Ordering::SeqCst);
        if self.u32(FUTEX_WORD).load(Ordering::Relaxed) == expected {
            *sleepers += 1;
            sleepers = self.alarm.wait(sleepers).unwrap();
            *sleepers -= 1;
        }
    }

    pub(crate) fn futex_wake(&self) -> u32 {
        let sleepers = self.sleepers.lock().unwrap();
        self.alarm.notify_all();
        *sleepers
    }
}

#[derive(Clone, Copy)]
pub(crate) struct Slot<'a> {
    words: &'a [AtomicU32],
}

impl Slot<'_> {
    pub(crate) fn load(&self, word: usize) -> u32 {
        self.words[word / 4].load(Ordering::Relaxed)
    }

    pub(crate) fn store(&self, word: usize, value: u32) {
        self.words[word / 4].store(value, Ordering::Relaxed);
    }

    pub(crate) fn write_payload(&self, at: usize, part: &[u8]) {
        for (i, word) in part.chunks_exact(4).enumerate() {
            let value = u32::from_le_bytes(std::array::from_fn(|byte| word[byte]));
            self.store(SLOT_HEADER_LEN + at + 4 * i, value);
        }
    }

    /// # Safety
    /// `to` is valid for writes of `len` bytes.
    pub(crate) unsafe fn read_payload(&self, to: *mut u8, len: usize) {
        for at in (0..len).step_by(4) {
            let value = self.load(SLOT_HEADER_LEN + at).to_le_bytes();
            // SAFETY: `to` has room for `len` bytes, and lengths are multiples of 4 here.
            unsafe { to.wrapping_add(at).cast::<[u8; 4]>().write_unaligned(value) };
        }
    }
}
