//! Messages: none is torn, none is missed, and a successor continues where its predecessor died.

use loom::thread;

use super::*;
use crate::layout::{SLOT_LEN, SLOT_SEQ_HI, SLOT_SEQ_LO, SLOT_TIME_HI, SLOT_TIME_LO, WRITE_IDX};
use crate::reader::Dialect;
use crate::sync::fence;
use crate::wait;
use crate::writer::notify;

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

/// Publishes as an unmodified conduit publisher does. Its wake-up call is a full barrier.
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

/// The steps of a message after which a publisher is killed.
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
                thread::spawn(move || {
                    read_times(1, &memory, Reader::resume(Dialect::Native, 0, 0))
                })
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
