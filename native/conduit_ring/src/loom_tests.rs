//! The protocol under loom: every interleaving of its memory accesses, up to a bound of preemptions, and every value
//! that a relaxed load may return. Run with
//!
//! ```text
//! RUSTFLAGS="--cfg loom" cargo test -p conduit_ring --release --lib loom
//! ```
//!
//! What each order is for can be seen by taking it away. Each of these makes the tests named beside it fail:
//!
//! | Weakened | Fails |
//! |---|---|
//! | the acquire fence in `Reader::is_whole` | `a_torn_message_is_never_accepted`, and of a legacy publisher |
//! | the release fence in `Writer::begin` | `a_torn_message_is_never_accepted` |
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
//! | the Acquire in `pins::holds` | `a_slot_is_overwritten_after_the_last_look_at_it` |
//! | `write_intent` taken back although something was begun | `what_a_loan_left_behind_is_never_accepted` |
//! | the SeqCst fence in `Writer::resume` | `a_first_pin_is_seen_by_a_successor` |
//! | length and time taken after the validation in `Reader::take_pinned` | `a_reader_that_pins_while…` |
//! | a pin counted for the next lap alone in `pins::holds_slot` | `a_successor_respects_what_is_held…` |
//! | `Reader::is_message` always true | `a_held_slot_is_passed_over_and_others_lose_its_number` |
//!
//! The SeqCst fence in `wait::sleep` has no line: the kernel has a full barrier of its own between the waiting bit and
//! its look at the futex word. The fence makes the protocol sound without counting on that.

use std::io;
use std::time::Duration;

use loom::cell::UnsafeCell;
use loom::model::Builder;
use loom::sync::Arc;
use loom::thread;

use crate::claim::{Claim, Claimant, ReaderSlotLocks, prepare, reclaim_leaked, reclaim_pins};
use crate::delivery::{Meta, Policy};
use crate::geometry::Geometry;
use crate::layout::{
    DROPPED_PINNED, FUTEX_WORD, NATIVE_MASK, PIN_MASK, ReaderSlot, SLOT_LEN, SLOT_SEQ_HI,
    SLOT_SEQ_LO, SLOT_TIME_HI, SLOT_TIME_LO, SUBSCRIBER_MASK, WRITE_IDX,
};
use crate::memory::Memory;
use crate::pins::{self, Announced};
use crate::reader::{Dialect, Reader};
use crate::sink::Sink;
use crate::sync::{AtomicU32, Ordering, fence};
use crate::wait;
use crate::writer::{Writer, notify};

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

/// Payload and time of a message say its number in two ways.
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

/// Reads a few times and checks that messages come whole, in order, and that the lost ones are counted.
fn read_times(times: u32, memory: &Memory, mut reader: Reader) {
    let mut expected = reader.cursor();
    for _ in 0..times {
        if let Some(meta) = read(&mut reader, memory) {
            assert_eq!(meta.sequence, expected + meta.lost);
            expected = meta.sequence + 1;
        }
    }
}

#[test]
fn a_torn_message_is_never_accepted() {
    check(3, || {
        let memory = two_slots();
        let mut writer = Writer::resume(&memory);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let reader = {
            let memory = memory.clone();
            thread::spawn(move || read_times(2, &memory, Reader::resume(Dialect::Native, 0, 0)))
        };
        publish(&mut writer, &memory);
        reader.join().unwrap();
    });
}

#[test]
fn two_readers_are_overtaken_and_accept_no_torn_message() {
    check(2, || {
        let memory = two_slots();
        let mut writer = Writer::resume(&memory);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let readers = [0, 1].map(|cursor| {
            let memory = memory.clone();
            let reader = Reader::resume(Dialect::Native, cursor, 0);
            thread::spawn(move || read_times(1, &memory, reader))
        });
        publish(&mut writer, &memory);
        readers
            .into_iter()
            .for_each(|reader| reader.join().unwrap());
    });
}

/// What an unmodified conduit publisher does, its wake-up call being a full barrier.
fn publish_legacy(memory: &Memory, n: u64) {
    let slot = memory.slot(n);
    slot.store(SLOT_LEN, 4);
    slot.store(SLOT_SEQ_LO, n as u32);
    slot.store(SLOT_SEQ_HI, (n >> 32) as u32);
    slot.store(SLOT_TIME_LO, time(n) as u32);
    slot.store(SLOT_TIME_HI, (time(n) >> 32) as u32);
    slot.write_payload(0, &payload(n));
    memory.u64(WRITE_IDX).store(n + 1, Ordering::Release);
    fence(Ordering::SeqCst);
}

#[test]
fn a_torn_message_of_a_legacy_publisher_is_never_accepted() {
    check(3, || {
        let memory = two_slots();
        publish_legacy(&memory, 0);
        let reader = {
            let memory = memory.clone();
            thread::spawn(move || read_times(2, &memory, Reader::resume(Dialect::Legacy, 0, 0)))
        };
        publish_legacy(&memory, 1);
        publish_legacy(&memory, 2);
        reader.join().unwrap();
    });
}

/// Marks a reader slot as claimed by a reader with the extension.
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

fn sleep_until_message(memory: &Memory, reader_slot: ReaderSlot, reader: &mut Reader) -> Meta {
    loop {
        if let Some(meta) = read(reader, memory) {
            return meta;
        }
        wait::sleep(memory, reader_slot, FOREVER, || reader.has_news(memory));
    }
}

#[test]
fn a_sleeper_is_always_woken() {
    check(3, || {
        let memory = two_slots();
        let reader_slot = claim_by_hand(&memory);
        let sleeper = {
            let memory = memory.clone();
            thread::spawn(move || {
                let mut reader = Reader::resume(Dialect::Native, 0, 0);
                assert_eq!(
                    sleep_until_message(&memory, reader_slot, &mut reader).sequence,
                    0
                );
            })
        };
        publish(&mut Writer::resume(&memory), &memory);
        sleeper.join().unwrap();
    });
}

/// How far a publisher came with a message before it was killed.
const STEPS: [fn(&mut Writer, &Memory); 4] = [
    |_, _| (),
    |writer, memory| writer.begin(memory).unwrap(),
    |writer, memory| {
        writer.begin(memory).unwrap();
        writer.fill(memory, &[&[0xFF; 4]]);
    },
    |writer, memory| {
        writer.begin(memory).unwrap();
        writer.fill(memory, &[&[0xFF; 4]]);
        writer.commit(memory, 4, 0);
    },
];

#[test]
fn a_successor_goes_on_at_the_same_number_wherever_the_predecessor_was_killed() {
    for killed_after in STEPS {
        check(2, move || {
            let memory = two_slots();
            let mut predecessor = Writer::resume(&memory);
            publish(&mut predecessor, &memory);
            publish(&mut predecessor, &memory);
            let reader = {
                let memory = memory.clone();
                thread::spawn(move || read_times(1, &memory, Reader::resume(Dialect::Native, 0, 0)))
            };
            killed_after(&mut predecessor, &memory);
            let mut successor = Writer::resume(&memory);
            assert_eq!(successor.next(), 2);
            notify(&memory);
            publish(&mut successor, &memory);
            reader.join().unwrap();
        });
    }
}

/// Locks as the kernel's: free again when their holder dies.
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

#[test]
fn two_claimants_never_share_a_line() {
    check(2, || {
        let (memory, locks) = (two_slots(), Locks::new());
        let other = {
            let (memory, locks) = (memory.clone(), locks.clone());
            thread::spawn(move || take(&memory, &locks, 2))
        };
        let mine = take(&memory, &locks, 1);
        let other = other.join().unwrap();
        for claim in [mine, other].into_iter().flatten() {
            assert!(claim.stands(&memory));
        }
        assert!(mine.or(other).is_some());
    });
}

#[test]
fn a_leaked_line_goes_to_one_claimant() {
    check(2, || {
        let (memory, locks) = (two_slots(), Locks::new());
        let leaked = take(&memory, &locks, 9).unwrap();
        let held = take(&memory, &locks, 8).unwrap();
        locks.unlock(leaked.reader_slot).unwrap();
        let other = {
            let (memory, locks) = (memory.clone(), locks.clone());
            thread::spawn(move || take(&memory, &locks, 2))
        };
        let mine = take(&memory, &locks, 1);
        let other = other.join().unwrap();
        let winners: Vec<Claim> = [mine, other].into_iter().flatten().collect();
        assert!(winners.len() <= 1);
        winners.iter().for_each(|winner| {
            assert!(winner.stands(&memory) && winner.reader_slot == leaked.reader_slot)
        });
        assert!(held.stands(&memory));
    });
}

#[test]
fn a_legacy_successor_of_a_bit_is_woken() {
    check(3, || {
        let (memory, locks) = (two_slots(), Locks::new());
        let native = take(&memory, &locks, 1).unwrap();
        let legacy = {
            let memory = memory.clone();
            thread::spawn(move || {
                let bit = native.reader_slot.bit();
                let free = memory.u32(SUBSCRIBER_MASK).fetch_or(bit, Ordering::AcqRel) & bit == 0;
                while free && memory.u64(WRITE_IDX).load(Ordering::Acquire) == 0 {
                    let seen = memory.u32(FUTEX_WORD).load(Ordering::Acquire);
                    if memory.u64(WRITE_IDX).load(Ordering::Acquire) == 0 {
                        memory.futex_wait(seen, FOREVER);
                    }
                }
            })
        };
        let publisher = {
            let memory = memory.clone();
            thread::spawn(move || {
                memory.u64(WRITE_IDX).store(1, Ordering::Release);
                notify(&memory);
            })
        };
        native.release(&memory, &*locks).unwrap();
        legacy.join().unwrap();
        publisher.join().unwrap();
    });
}

#[test]
fn reclaiming_spares_a_legacy_successor() {
    check(3, || {
        let (memory, locks) = (two_slots(), Locks::new());
        let leaked = take(&memory, &locks, 9).unwrap();
        locks.unlock(leaked.reader_slot).unwrap();
        let other = {
            let (memory, locks) = (memory.clone(), locks.clone());
            thread::spawn(move || reclaim_leaked(&memory, &*locks).unwrap())
        };
        reclaim_leaked(&memory, &*locks).unwrap();
        let (mask, bit) = (memory.u32(SUBSCRIBER_MASK), leaked.reader_slot.bit());
        let claimed = mask.fetch_or(bit, Ordering::AcqRel) & bit == 0;
        other.join().unwrap();
        assert!(!claimed || mask.load(Ordering::Relaxed) & bit != 0);
    });
}

/// A reader that pins. Like `Attachment::lease`.
struct Pinner {
    reader: Reader,
    reader_slot: ReaderSlot,
    announced: Announced,
}

impl Pinner {
    fn begin(memory: &Memory, cursor: u64) -> Pinner {
        let reader_slot = claim_by_hand(memory);
        Pinner {
            reader: Reader::resume(Dialect::Native, cursor, 0),
            reader_slot,
            announced: pins::announce(memory, reader_slot),
        }
    }

    /// Pins the next message, if one is protected and whole, and checks what is in its slot.
    fn pin(&mut self, memory: &Memory) -> Option<Meta> {
        let pin = self.reader_slot.pins()[0];
        let announced = self.announced;
        let meta = self.reader.search(memory, Policy::All, |reader| {
            announced
                .protects(memory, reader.cursor())
                .then(|| reader.take_pinned(memory, pin))?
        })?;
        self.check(memory, &meta);
        Some(meta)
    }

    /// A pinned message is what was published, whatever the writer does: its bytes, and what was taken of its header.
    fn check(&self, memory: &Memory, meta: &Meta) {
        let mut word = [0; 4];
        // SAFETY: the word has room for 4 bytes.
        unsafe {
            memory
                .slot(meta.sequence)
                .read_payload(word.as_mut_ptr(), 4)
        };
        assert_eq!(
            (meta.len, meta.timestamp_ns, word),
            (4, time(meta.sequence), payload(meta.sequence))
        );
    }

    fn unpin(&self, memory: &Memory) {
        pins::unpin(memory, self.reader_slot.pins()[0]);
    }
}

/// Publishes behind the slots that are held, as `Publisher` does; `false` when all are.
fn try_publish(writer: &mut Writer, memory: &Memory) -> bool {
    loop {
        let n = writer.next();
        if writer.publish(memory, &[&payload(n)], time(n)).is_ok() {
            return true;
        }
        if !writer.pass_over(memory) {
            writer.drop_pinned(memory);
            return false;
        }
    }
}

#[test]
fn a_pinned_message_stays_as_it_is() {
    check(3, || {
        let memory = two_slots();
        let mut writer = Writer::resume(&memory);
        let mut pinner = Pinner::begin(&memory, 0);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let reader = {
            let memory = memory.clone();
            thread::spawn(move || {
                if let Some(meta) = pinner.pin(&memory) {
                    pinner.check(&memory, &meta);
                    pinner.unpin(&memory);
                }
            })
        };
        try_publish(&mut writer, &memory);
        reader.join().unwrap();
    });
}

#[test]
fn a_first_pin_is_seen_or_not_set() {
    check(3, || {
        let memory = two_slots();
        let mut writer = Writer::resume(&memory);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let reader = {
            let memory = memory.clone();
            thread::spawn(move || {
                let mut pinner = Pinner::begin(&memory, 0);
                if let Some(meta) = pinner.pin(&memory) {
                    pinner.check(&memory, &meta);
                }
            })
        };
        try_publish(&mut writer, &memory);
        try_publish(&mut writer, &memory);
        reader.join().unwrap();
    });
}

#[test]
fn a_first_pin_is_seen_by_a_successor() {
    check(3, || {
        let memory = two_slots();
        let mut predecessor = Writer::resume(&memory);
        publish(&mut predecessor, &memory);
        let reader = {
            let memory = memory.clone();
            thread::spawn(move || {
                let mut pinner = Pinner::begin(&memory, 0);
                if let Some(meta) = pinner.pin(&memory) {
                    pinner.check(&memory, &meta);
                }
            })
        };
        // Killed before it came to the fence behind its message.
        predecessor.begin(&memory).unwrap();
        let n = predecessor.next();
        predecessor.fill(&memory, &[&payload(n)]);
        predecessor.commit(&memory, 4, time(n));
        predecessor.advance(&memory, time(n));
        try_publish(&mut Writer::resume(&memory), &memory);
        reader.join().unwrap();
    });
}

/// Stands for a slot's bytes. Loom's loads never see what is stored later, so that it is told here that looking must have
/// happened before overwriting.
struct Bytes(UnsafeCell<()>);

// SAFETY: loom reports what is not in order.
unsafe impl Sync for Bytes {}

#[test]
fn a_slot_is_overwritten_after_the_last_look_at_it() {
    check(3, || {
        let memory = two_slots();
        let bytes = Arc::new(Bytes(UnsafeCell::new(())));
        let mut writer = Writer::resume(&memory);
        let mut pinner = Pinner::begin(&memory, 0);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let meta = pinner.pin(&memory).unwrap();
        let reader = {
            let (memory, bytes) = (memory.clone(), bytes.clone());
            thread::spawn(move || {
                pinner.check(&memory, &meta);
                bytes.0.with(|_| ());
                pinner.unpin(&memory);
            })
        };
        if writer.begin(&memory).is_ok() {
            bytes.0.with_mut(|_| ());
        }
        reader.join().unwrap();
    });
}

#[test]
fn a_held_slot_is_passed_over_and_others_lose_its_number() {
    check(1, || {
        let memory = two_slots();
        let mut writer = Writer::resume(&memory);
        let mut pinner = Pinner::begin(&memory, 0);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let meta = pinner.pin(&memory).unwrap();
        let other = {
            let memory = memory.clone();
            thread::spawn(move || read_times(1, &memory, Reader::resume(Dialect::Native, 0, 0)))
        };
        assert!(try_publish(&mut writer, &memory));
        assert_eq!(writer.next(), 4);
        assert_eq!(memory.u64(DROPPED_PINNED).load(Ordering::Relaxed), 1);
        pinner.check(&memory, &meta);
        other.join().unwrap();
        let mut late = Reader::resume(Dialect::Native, 1, 0);
        assert_eq!(
            read(&mut late, &memory).map(|meta| (meta.sequence, meta.lost)),
            Some((3, 2))
        );
        pinner.unpin(&memory);
        assert!(try_publish(&mut writer, &memory));
        assert_eq!(read(&mut late, &memory).map(|meta| meta.sequence), Some(4));
    });
}

#[test]
fn a_reader_that_pins_while_the_slot_is_passed_over_for_another_gets_a_message_or_nothing() {
    check(3, || {
        let memory = two_slots();
        let mut writer = Writer::resume(&memory);
        let mut holder = Pinner::begin(&memory, 0);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let meta = holder.pin(&memory).unwrap();
        let second = {
            let memory = memory.clone();
            thread::spawn(move || {
                // In the same reader slot, by its second pin.
                let reader_slot = ReaderSlot::all().next().unwrap();
                let mut reader = Reader::resume(Dialect::Native, 0, 0);
                if let Some(meta) = reader.take_pinned(&memory, reader_slot.pins()[1]) {
                    holder.check(&memory, &meta);
                }
            })
        };
        assert!(writer.begin(&memory).is_err());
        assert!(writer.pass_over(&memory));
        second.join().unwrap();
        assert_eq!(meta.len, 4);
    });
}

#[test]
fn whoever_pins_twice_round_the_ring_holds_what_was_published() {
    check(2, || {
        let memory = two_slots();
        let mut writer = Writer::resume(&memory);
        let mut pinner = Pinner::begin(&memory, 0);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let reader = {
            let memory = memory.clone();
            thread::spawn(move || {
                if let Some(meta) = pinner.pin(&memory) {
                    pinner.check(&memory, &meta);
                    pinner.check(&memory, &meta);
                }
            })
        };
        try_publish(&mut writer, &memory);
        try_publish(&mut writer, &memory);
        reader.join().unwrap();
    });
}

#[test]
fn a_successor_respects_what_is_held_wherever_its_predecessor_was_killed() {
    const STEPS: [fn(&mut Writer, &Memory); 3] = [
        |_, _| (),
        // In the midst of looking at the pins.
        |writer, memory| {
            let intent = memory.u64(crate::layout::WRITE_INTENT);
            intent.store(writer.next() + 1, Ordering::Relaxed);
        },
        |writer, memory| {
            let _ = writer.begin(memory);
            writer.pass_over(memory);
        },
    ];
    for killed_after in STEPS {
        check(1, move || {
            let memory = two_slots();
            let mut predecessor = Writer::resume(&memory);
            let mut pinner = Pinner::begin(&memory, 0);
            publish(&mut predecessor, &memory);
            publish(&mut predecessor, &memory);
            let meta = pinner.pin(&memory).unwrap();
            let other = {
                let memory = memory.clone();
                thread::spawn(move || read_times(1, &memory, Reader::resume(Dialect::Native, 0, 0)))
            };
            killed_after(&mut predecessor, &memory);
            assert!(try_publish(&mut Writer::resume(&memory), &memory));
            pinner.check(&memory, &meta);
            other.join().unwrap();
        });
    }
}

#[test]
fn what_a_loan_left_behind_is_never_accepted() {
    check(2, || {
        let memory = two_slots();
        let mut writer = Writer::resume(&memory);
        let mut pinner = Pinner::begin(&memory, 0);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let reader = {
            let memory = memory.clone();
            thread::spawn(move || {
                if let Some(meta) = pinner.pin(&memory) {
                    pinner.check(&memory, &meta);
                    pinner.unpin(&memory);
                }
                read_times(1, &memory, Reader::resume(Dialect::Native, 0, 0));
            })
        };
        // A loan that is written to and not committed, and then another message.
        if writer.begin(&memory).is_ok() {
            writer.fill(&memory, &[&[0xFF; 4]]);
        }
        try_publish(&mut writer, &memory);
        reader.join().unwrap();
    });
}

#[test]
fn pins_of_the_dead_are_taken_back_and_those_of_the_living_are_not() {
    check(2, || {
        let (memory, locks) = (two_slots(), Locks::new());
        let mut writer = Writer::resume(&memory);
        publish(&mut writer, &memory);
        publish(&mut writer, &memory);
        let claim = take(&memory, &locks, 1).unwrap();
        pins::announce(&memory, claim.reader_slot);
        pins::pin(&memory, claim.reader_slot.pins()[0], 0);
        let claimant = {
            let (memory, locks) = (memory.clone(), locks.clone());
            thread::spawn(move || {
                locks.unlock(claim.reader_slot).unwrap();
                take(&memory, &locks, 2)
            })
        };
        let held = |memory: &Memory| memory.u32(PIN_MASK).load(Ordering::Relaxed) != 0;
        let before = held(&memory);
        let reclaimed = reclaim_pins(&memory, &*locks, claim.reader_slot.bit()).unwrap();
        assert!(!before || !reclaimed || !held(&memory));
        let successor = claimant.join().unwrap();
        assert!(successor.is_none_or(|successor| successor.stands(&memory)));
        assert!(reclaimed || successor.is_some());
        assert!(try_publish(&mut writer, &memory));
    });
}
