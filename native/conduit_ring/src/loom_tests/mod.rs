//! The protocol under loom: every interleaving of its memory accesses, up to a bound of
//! preemptions, and every value that a relaxed load may return. Run with
//!
//! ```text
//! RUSTFLAGS="--cfg loom" cargo test -p conduit_ring --release --lib loom
//! ```
//!
//! The tests also show what each ordering is for. Each of these changes makes the test beside it
//! fail:
//!
//! | weakened | fails |
//! |---|---|
//! | the acquire fence in `Reader::is_whole` | `a_torn_message_is_never_accepted`, and of a legacy publisher |
//! | the release fence in `Writer::poison` | `a_torn_message_is_never_accepted` |
//! | the lap bound of `Reader::is_overwritten` by one, native | `a_torn_message_is_never_accepted` |
//! | the lap bound of `Reader::is_overwritten` by one, legacy | `a_torn_message_of_a_legacy_publisher_is_never_accepted` |
//! | the SeqCst fence in `sync::add_one_and_fence`, behind the bump of `notify` | `a_sleeper_is_always_woken` |
//! | the order in `claim::clear`: mask bit before native bit | `a_legacy_successor_of_a_bit_is_woken` |
//! | the second look under the lock in `claim::reclaim_leaked` | `reclaiming_spares_a_legacy_successor` |
//! | `write_intent` announced too low by one | `a_torn_message_is_never_accepted` |
//! | `write_intent` set back to `write_idx` at a takeover | `a_successor_goes_on_at_the_same_number…` |
//! | the SeqCst fence in `pins::pin` | `a_pinned_message_stays_as_it_is` |
//! | the SeqCst fence in `pins::holders` | `a_pinned_message_stays_as_it_is` |
//! | the SeqCst fence in `pins::announce` | `a_first_pin_is_seen_or_not_set` |
//! | `Announced::protects` always true | `a_first_pin_is_seen_or_not_set` |
//! | the Release in `pins::unpin` | `a_slot_is_overwritten_after_the_last_look_at_it` |
//! | the Acquire in `pins::holds_slot` | `a_slot_is_overwritten_after_the_last_look_at_it` |
//! | `write_intent` taken back although something was begun | `what_a_loan_left_behind_is_never_accepted` |
//! | the SeqCst fence in `Writer::resume` | `a_first_pin_is_seen_by_a_successor` |
//! | length and time taken after the validation in `Reader::take_pinned` | `a_reader_that_pins_while…` |
//! | a pin counted for the next lap alone in `pins::holds_slot` | `a_successor_respects_held_messages…` |
//! | `Reader::is_message` always true | `a_held_slot_is_passed_over_and_others_lose_its_number` |
//!
//! No test needs the SeqCst fence in `wait::sleep`: the kernel has a full barrier of its own
//! between the waiting bit and its look at the futex word. With the fence the protocol is sound
//! without it.

mod messages;
mod pinned;
mod reader_slots;

use std::io;
use std::time::Duration;

use loom::model::Builder;
use loom::sync::Arc;

use crate::claim::{Claim, Claimant, ReaderSlotLocks, prepare};
use crate::delivery::{Meta, Policy};
use crate::geometry::Geometry;
use crate::layout::{NATIVE_MASK, ReaderSlot, SUBSCRIBER_MASK};
use crate::memory::Memory;
use crate::reader::Reader;
use crate::sink::Sink;
use crate::sync::{AtomicU32, Ordering};
use crate::writer::Writer;

const FOREVER: Duration = Duration::MAX;

fn check(preemptions: usize, model: impl Fn() + Sync + Send + 'static) {
    let mut builder = Builder::new();
    builder.preemption_bound = Some(preemptions);
    builder.check(model);
}

fn two_slots() -> Arc<Memory> {
    let memory = Memory::new(Geometry::exact(2, 24).unwrap());
    prepare(&memory);
    Arc::new(memory)
}

/// Publishes a message whose payload and time follow from its number.
fn publish(writer: &mut Writer, memory: &Memory) {
    let n = writer.next();
    writer.publish(memory, &[&payload(n)], time(n)).unwrap();
}

fn payload(n: u64) -> [u8; 4] {
    (n as u32 + 100).to_le_bytes()
}

fn time(n: u64) -> u64 {
    (n + 10) << 32 | (n + 20)
}

struct Word([u8; 4]);

// SAFETY: the lengths published here are 4.
unsafe impl Sink for Word {
    fn room(&mut self, len: usize) -> *mut u8 {
        assert!(len <= 4);
        self.0.as_mut_ptr()
    }
}

fn read(reader: &mut Reader, memory: &Memory) -> Option<Meta> {
    let mut word = Word([0; 4]);
    let meta = reader.next(memory, Policy::All, &mut word)?;
    assert_eq!(
        (meta.len, word.0, meta.timestamp_ns),
        (4, payload(meta.sequence), time(meta.sequence))
    );
    Some(meta)
}

/// Reads a few times. Checks that messages come whole and in order, and that lost ones are
/// counted.
fn read_times(times: u32, memory: &Memory, mut reader: Reader) {
    let mut expected = reader.cursor();
    for _ in 0..times {
        if let Some(meta) = read(&mut reader, memory) {
            assert_eq!(meta.sequence, expected + meta.lost);
            expected = meta.sequence + 1;
        }
    }
}

/// Marks a reader slot as claimed by a native reader.
fn claim_by_hand(memory: &Memory) -> ReaderSlot {
    let reader_slot = ReaderSlot::all().next().unwrap();
    memory
        .u32(SUBSCRIBER_MASK)
        .fetch_or(reader_slot.bit(), Ordering::Relaxed);
    memory
        .u32(NATIVE_MASK)
        .fetch_or(reader_slot.bit(), Ordering::Relaxed);
    reader_slot
}

/// Locks like the kernel's. A test frees the lock of a reader that dies.
struct Locks(Vec<AtomicU32>);

impl Locks {
    fn new() -> Arc<Locks> {
        Arc::new(Locks(
            ReaderSlot::all().map(|_| AtomicU32::new(0)).collect(),
        ))
    }

    fn of(&self, reader_slot: ReaderSlot) -> &AtomicU32 {
        &self.0[reader_slot.index() as usize]
    }
}

impl ReaderSlotLocks for Locks {
    fn try_lock(&self, reader_slot: ReaderSlot) -> io::Result<bool> {
        Ok(self
            .of(reader_slot)
            .compare_exchange(0, 1, Ordering::Acquire, Ordering::Relaxed)
            .is_ok())
    }

    fn unlock(&self, reader_slot: ReaderSlot) -> io::Result<()> {
        self.of(reader_slot).store(0, Ordering::Release);
        Ok(())
    }
}

fn take(memory: &Memory, locks: &Locks, id: u64) -> Option<Claim> {
    Claim::take(
        memory,
        locks,
        Claimant {
            id,
            pid: 0,
            start_time: 0,
        },
    )
    .unwrap()
}
