//! Reader slots: each has one reader, and a dead reader's slot is taken back from it alone.

use loom::thread;

use super::*;
use crate::claim::reclaim_leaked;
use crate::layout::{FUTEX_WORD, WRITE_IDX};
use crate::writer::notify;

#[test]
fn two_claimants_never_share_a_reader_slot() {
    check(2, || {
        let (memory, locks) = (two_slots(), Locks::new());
        let other = {
            let (memory, locks) = (memory.clone(), locks.clone());
            thread::spawn(move || take(&memory, &locks, 2))
        };
        let mine = take(&memory, &locks, 1);
        let other = other.join().unwrap();
        for claim in [mine, other].into_iter().flatten() {
            assert!(claim.is_current(&memory));
        }
        assert!(mine.or(other).is_some());
    });
}

#[test]
fn a_leaked_reader_slot_goes_to_one_claimant() {
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
            assert!(winner.is_current(&memory) && winner.reader_slot == leaked.reader_slot)
        });
        assert!(held.is_current(&memory));
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
