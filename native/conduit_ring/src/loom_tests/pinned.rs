//! Pins: a held message stays as it is, and the writer passes its slot over.

use loom::cell::UnsafeCell;
use loom::thread;

use super::*;
use crate::claim::reclaim_pins;
use crate::layout::{DROPPED_PINNED, PIN_MASK};
use crate::pins::{self, Announced};
use crate::reader::Dialect;

/// A reader that pins, as `Attachment::lease` does.
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

    /// Pins the next message, if one is protected and whole, and checks its slot.
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

    /// Checks that a pinned message is the published one, whatever the writer does: its bytes,
    /// and length and time as they were read.
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

/// Publishes behind the slots that are held, as `Publication` does. Returns `false` when all are.
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
        // Killed before the fence behind its message.
        predecessor.begin(&memory).unwrap();
        let n = predecessor.next();
        predecessor.fill(&memory, &[&payload(n)]);
        predecessor.commit(&memory, 4, time(n));
        predecessor.advance(&memory, time(n));
        try_publish(&mut Writer::resume(&memory), &memory);
        reader.join().unwrap();
    });
}

/// Stands for the bytes of a slot. Loom's loads never see a later store, so that this cell checks
/// that the look happened before the overwriting.
struct Bytes(UnsafeCell<()>);

// SAFETY: loom reports accesses that are not ordered.
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
fn a_reader_that_pins_for_two_laps_holds_the_published_message() {
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
        // While it looks at the pins.
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
                thread::spawn(move || {
                    read_times(1, &memory, Reader::resume(Dialect::Native, 0, 0))
                })
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
        assert!(successor.is_none_or(|successor| successor.is_current(&memory)));
        assert!(reclaimed || successor.is_some());
        assert!(try_publish(&mut writer, &memory));
    });
}
