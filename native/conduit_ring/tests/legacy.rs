//! Unmodified conduit peers, made byte for byte from the description of the format.
#![cfg(not(loom))]

mod support;

use std::fs::OpenOptions;
use std::sync::atomic::{AtomicU64, Ordering::*};
use std::thread;
use std::time::Instant;

use conduit_ring::{
    Error, Info, Observer, ObserverOptions, Publisher, PublisherOptions, Read, Received, Start,
    State, Subscriber, SubscriberOptions, Topic, repair,
};
use support::{LONG, Raw, Scratch, next, next_message};

const SLOTS: u64 = 4;
const HEADER: usize = 1216;

/// A publisher as conduit's: it ignores the extension and wakes the readers after each message.
struct LegacyPublisher {
    raw: Raw,
    slot_size: usize,
}

impl LegacyPublisher {
    fn create(topic: &Topic, slot_size: usize) -> LegacyPublisher {
        let len = HEADER + SLOTS as usize * slot_size;
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(topic.path())
            .unwrap();
        file.set_len(len as u64).unwrap();
        let raw = Raw::open(topic).unwrap();
        raw.u32(0).store(SLOTS as u32, Relaxed);
        raw.u32(4).store(slot_size as u32, Relaxed);
        raw.u32(8).store(16, Relaxed);
        LegacyPublisher { raw, slot_size }
    }

    fn publish(&self, payload: &[u8]) {
        let n = self.raw.u64(64).load(Relaxed);
        let slot = HEADER + (n % SLOTS) as usize * self.slot_size;
        self.raw.write(slot, &(payload.len() as u32).to_le_bytes());
        self.raw.write(slot + 4, &n.to_le_bytes());
        self.raw.write(slot + 12, &(n + 1000).to_le_bytes());
        self.raw.write(slot + 20, payload);
        self.raw.u64(64).store(n + 1, Release);
        self.raw.u32(132).fetch_add(1, SeqCst);
        self.raw.futex_wake();
    }
}

/// A subscriber as conduit's: it claims a bit, keeps its cursor in the segment and sleeps without
/// a time limit. When it finds a number that it does not expect, it goes back by a whole ring.
struct LegacySubscriber {
    raw: Raw,
    index: usize,
    slot_count: u64,
    slot_size: usize,
}

impl LegacySubscriber {
    fn open(topic: &Topic) -> LegacySubscriber {
        let raw = Raw::open(topic).unwrap();
        let slot_count = u64::from(raw.u32(0).load(Relaxed));
        let slot_size = raw.u32(4).load(Relaxed) as usize;
        let index = loop {
            let mask = raw.u32(128).load(SeqCst);
            let free = (!mask).trailing_zeros();
            if raw
                .u32(128)
                .compare_exchange(mask, mask | 1 << free, SeqCst, SeqCst)
                .is_ok()
            {
                break free as usize;
            }
        };
        assert!(index < 16);
        raw.u64(192 + 64 * index)
            .store(raw.u64(64).load(Acquire), Release);
        LegacySubscriber {
            raw,
            index,
            slot_count,
            slot_size,
        }
    }

    fn try_read(&self) -> Option<(u64, Vec<u8>)> {
        let cursor = self.raw.u64(192 + 64 * self.index);
        let published = self.raw.u64(64).load(Acquire);
        let n = cursor.load(Relaxed);
        if n == published {
            return None;
        }
        let slot = HEADER + (n & (self.slot_count - 1)) as usize * self.slot_size;
        let field =
            |at: usize| u64::from_le_bytes(self.raw.read(slot + at, 8).try_into().unwrap());
        if field(4) != n {
            cursor.store(published.saturating_sub(self.slot_count), Release);
            return None;
        }
        let payload = self.raw.read(slot + 20, field(0) as u32 as usize);
        cursor.store(n + 1, Release);
        Some((n, payload))
    }

    fn wait(&self) -> (u64, Vec<u8>) {
        loop {
            let seen = self.raw.u32(132).load(Acquire);
            if let Some(message) = self.try_read() {
                return message;
            }
            self.raw.futex_wait(seen);
        }
    }

    fn close(self) {
        self.raw.u32(128).fetch_and(!(1 << self.index), SeqCst);
    }
}

fn publisher(topic: &Topic) -> Publisher {
    Publisher::open(topic, &PublisherOptions::default()).unwrap()
}

fn subscriber(topic: &Topic, start: Start) -> Subscriber {
    Subscriber::open(
        topic,
        &SubscriberOptions {
            start,
            ..Default::default()
        },
    )
    .unwrap()
}

#[test]
fn a_legacy_subscriber_reads_the_messages_of_a_publisher() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let legacy = LegacySubscriber::open(&topic);
    for n in 0..40 {
        publisher
            .publish(format!("message {n}").as_bytes())
            .unwrap();
        assert_eq!(
            legacy.try_read(),
            Some((n, format!("message {n}").into_bytes()))
        );
    }
    assert_eq!(legacy.try_read(), None);
}

#[test]
fn a_legacy_subscriber_gets_one_empty_message_for_a_slot_that_a_reader_holds() {
    let topic = Scratch::new();
    let options = PublisherOptions {
        geometry: conduit_ring::Geometry::slots(4, 64).unwrap(),
        ..Default::default()
    };
    let mut publisher = Publisher::open(&topic, &options).unwrap();
    let legacy = LegacySubscriber::open(&topic);
    let mut holder = subscriber(&topic, Start::New);
    let mut hold = || match holder.try_lease().unwrap() {
        Received::Message(_, lease) => lease,
        other => panic!("{other:?}"),
    };
    publisher.publish(b"first").unwrap();
    drop(hold());
    publisher.publish(b"held").unwrap();
    let lease = hold();
    assert!(lease.holds_slot());
    assert_eq!(legacy.try_read(), Some((0, b"first".to_vec())));
    assert_eq!(legacy.try_read(), Some((1, b"held".to_vec())));
    for n in 2..30 {
        let empty = n % 4 == 1;
        if empty {
            assert_eq!(publisher.publish(b"on"), Ok(n + 1), "passes {n} over");
            assert_eq!(legacy.try_read(), Some((n, b"".to_vec())));
        } else if n % 4 != 2 || n == 2 {
            assert_eq!(publisher.publish(b"on"), Ok(n));
        }
        if !empty {
            assert_eq!(legacy.try_read(), Some((n, b"on".to_vec())));
        }
    }
    assert_eq!(legacy.try_read(), Some((30, b"on".to_vec())));
    assert_eq!(
        (legacy.try_read(), lease.to_vec()),
        (None, b"held".to_vec())
    );
}

#[test]
fn a_sleeping_legacy_subscriber_is_woken_also_in_the_slot_of_a_native_one_that_left() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut native = subscriber(&topic, Start::New);
    assert!(publisher.info().readers[0].native);
    native.wait(std::time::Duration::from_millis(1)).unwrap();
    drop(native);
    let legacy = LegacySubscriber::open(&topic);
    assert_eq!(legacy.index, 0);
    assert!(!publisher.info().readers[0].native);
    let sleeper = thread::spawn(move || (0..3).map(|_| legacy.wait().0).collect::<Vec<u64>>());
    for _ in 0..3 {
        publisher.publish(b"wake up").unwrap();
    }
    assert_eq!(sleeper.join().unwrap(), [0, 1, 2]);
    assert_eq!(publisher.info().wake_count, 3);
}

#[test]
fn a_slot_that_is_being_written_is_no_data_for_a_legacy_subscriber() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let legacy = LegacySubscriber::open(&topic);
    publisher.publish(b"whole").unwrap();
    legacy.raw.write(HEADER + 8, &[0xFF; 4]);
    assert_eq!(legacy.try_read(), None);
}

#[test]
fn legacy_and_native_subscribers_share_the_reader_slots() {
    let topic = Scratch::new();
    let publisher = publisher(&topic);
    let legacy = LegacySubscriber::open(&topic);
    let natives: Vec<_> = (0..15).map(|_| subscriber(&topic, Start::New)).collect();
    let full = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap_err();
    assert!(matches!(full, Error::NoReaderSlot { .. }), "{full}");
    assert_eq!(publisher.info().readers.len(), 16);
    legacy.close();
    drop(subscriber(&topic, Start::New));
    drop(natives);
    assert_eq!(publisher.info().readers, []);
    assert_eq!(
        LegacySubscriber::open(&topic).raw.u32(128).load(Relaxed),
        1,
        "bits 16..31 stay clear"
    );
}

#[test]
fn a_subscriber_reads_the_messages_of_a_legacy_publisher_at_any_alignment_of_its_slots() {
    for slot_size in [4096, 100, 101, 102, 103] {
        let topic = Scratch::new();
        let legacy = LegacyPublisher::create(&topic, slot_size);
        let mut subscriber = subscriber(&topic, Start::New);
        let mut buffer = Vec::new();
        for n in 0..20_u64 {
            legacy.publish(format!("message {n}").as_bytes());
            let read = next(&mut subscriber, &mut buffer);
            let Read::Message(meta) = read else {
                panic!("{read:?}")
            };
            let got = (meta.sequence, meta.timestamp_ns, meta.lost);
            assert_eq!(got, (n, n + 1000, 0));
            assert_eq!(buffer, format!("message {n}").into_bytes());
        }
        assert_eq!(subscriber.try_read(&mut buffer).unwrap(), Read::Nothing);
    }
}

#[test]
fn a_legacy_publisher_has_one_usable_slot_fewer() {
    let topic = Scratch::new();
    let legacy = LegacyPublisher::create(&topic, 4096);
    let mut reader = subscriber(&topic, Start::New);
    for _ in 0..10 {
        legacy.publish(b"x");
    }
    let mut buffer = Vec::new();
    assert_eq!(next_message(&mut reader, &mut buffer), (7, 7));
    let mut history = subscriber(&topic, Start::History(100));
    assert_eq!(next_message(&mut history, &mut buffer), (7, 0));
    let info = Info::read(&topic).unwrap();
    assert_eq!(
        (info.state, info.published, info.instance_id),
        (State::Legacy, 10, 0)
    );
}

#[test]
fn a_sleeping_subscriber_is_woken_by_a_legacy_publisher() {
    let topic = Scratch::new();
    let legacy = LegacyPublisher::create(&topic, 4096);
    let mut subscriber = subscriber(&topic, Start::New);
    let sleeper = thread::spawn(move || next_message(&mut subscriber, &mut Vec::new()));
    legacy.publish(b"wake up");
    assert_eq!(sleeper.join().unwrap(), (0, 0));
}

#[test]
fn a_legacy_publisher_that_makes_its_file_anew_is_followed() {
    let topic = Scratch::new();
    let first = LegacyPublisher::create(&topic, 4096);
    let mut subscriber = subscriber(&topic, Start::New);
    let mut buffer = Vec::new();
    first.publish(b"old");
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    std::fs::remove_file(topic.path()).unwrap();
    let second = LegacyPublisher::create(&topic, 1024);
    second.publish(b"new");
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherDown);
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherUp);
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    assert_eq!(buffer, b"new");
}

#[test]
fn a_legacy_publisher_that_clears_the_header_in_place_takes_no_claim_away_for_long() {
    let topic = Scratch::new();
    let legacy = LegacyPublisher::create(&topic, 4096);
    let mut subscriber = subscriber(&topic, Start::New);
    legacy.raw.write(64, &[0; HEADER - 64]);
    let waiting = subscriber
        .wait(std::time::Duration::from_millis(1200))
        .unwrap();
    assert_eq!(waiting, conduit_ring::Wait::TimedOut);
    let readers = Info::read(&topic).unwrap().readers;
    assert!(
        matches!(&readers[..], [reader] if reader.native && reader.alive),
        "{readers:?}"
    );
    legacy.publish(b"after");
    assert_eq!(next_message(&mut subscriber, &mut Vec::new()), (0, 0));
}

#[test]
fn a_native_publisher_replaces_a_legacy_file_only_if_no_process_uses_it_or_by_force() {
    let topic = Scratch::new();
    let legacy = LegacyPublisher::create(&topic, 4096);
    let refusal = Publisher::open(&topic, &PublisherOptions::default()).unwrap_err();
    assert!(matches!(refusal, Error::LegacyInUse { .. }), "{refusal}");
    drop(legacy);
    drop(publisher(&topic));

    let _legacy = LegacyPublisher::create(&topic, 4096);
    let force = PublisherOptions {
        force: true,
        ..Default::default()
    };
    let mut forced = Publisher::open(&topic, &force).unwrap();
    assert_eq!(forced.publish(b"x"), Ok(0));
    assert_eq!(Info::read(&topic).unwrap().state, State::Live);
}

/// Makes the topic as conduit's publisher does when it starts: in a new file.
fn restart(topic: &Topic) -> LegacyPublisher {
    let _ = std::fs::remove_file(topic.path());
    LegacyPublisher::create(topic, 64)
}

#[test]
fn a_legacy_publisher_that_restarts_fifteen_times_loses_no_uncounted_message() {
    let topic = Scratch::new();
    let mut legacy = restart(&topic);
    let mut reader = subscriber(&topic, Start::New);
    let seen = AtomicU64::new(0);
    thread::scope(|scope| {
        let reading = scope.spawn(|| {
            let mut buffer = Vec::new();
            while seen.load(Relaxed) < 300 {
                if let Read::Message(meta) = next(&mut reader, &mut buffer) {
                    seen.fetch_add(1 + meta.lost, Relaxed);
                }
            }
            reader.stats()
        });
        for life in 1..=15 {
            for _ in 0..20 {
                legacy.publish(b"message");
            }
            // It closes and restarts as soon as its last life was noticed, or after a while.
            let patience = Instant::now() + LONG;
            while seen.load(Relaxed) < 20 * life {
                assert!(Instant::now() < patience, "{seen:?} of {}", 20 * life);
                thread::yield_now();
            }
            if life < 15 {
                legacy = restart(&topic);
            }
        }
        let stats = reading.join().unwrap();
        assert_eq!(stats.delivered + stats.lost, 300);
    });
}

#[test]
fn a_legacy_publisher_that_died_under_native_readers_is_reported_and_succeeded() {
    let topic = Scratch::new();
    let legacy = LegacyPublisher::create(&topic, 64);
    let mut reader = subscriber(&topic, Start::New);
    let mut observer = Observer::open(&topic, &ObserverOptions::default()).unwrap();
    let mut buffer = Vec::new();
    legacy.publish(b"last words");
    let refusal = Publisher::open(&topic, &PublisherOptions::default()).unwrap_err();
    assert!(matches!(refusal, Error::LegacyInUse { .. }), "{refusal}");
    assert!(!repair::is_left_by_legacy_publisher(&topic).unwrap());
    assert_eq!(next_message(&mut reader, &mut buffer), (0, 0));
    drop(legacy);
    assert_eq!(next(&mut reader, &mut buffer), Read::PublisherDown);
    while observer.read_timeout(&mut buffer, LONG).unwrap() != Read::PublisherDown {}
    assert!(!reader.publisher_up());
    assert!(repair::is_left_by_legacy_publisher(&topic).unwrap());

    let mut ours = publisher(&topic);
    assert_eq!(next(&mut reader, &mut buffer), Read::PublisherUp);
    ours.publish(b"first words").unwrap();
    assert_eq!(next_message(&mut reader, &mut buffer), (0, 0));
    assert_eq!(buffer, b"first words");
}

#[test]
fn a_legacy_publisher_that_is_silent_and_lives_stays_up() {
    let topic = Scratch::new();
    let legacy = LegacyPublisher::create(&topic, 64);
    let mut reader = subscriber(&topic, Start::New);
    let waited = reader.wait(std::time::Duration::from_millis(2500)).unwrap();
    assert_eq!(waited, conduit_ring::Wait::TimedOut);
    assert!(reader.publisher_up());
    legacy.publish(b"at last");
    assert_eq!(next_message(&mut reader, &mut Vec::new()), (0, 0));
}

#[test]
fn a_legacy_publisher_that_publishes_after_it_was_found_dead_is_up_again() {
    let topic = Scratch::new();
    drop(LegacyPublisher::create(&topic, 64));
    let mut reader = subscriber(&topic, Start::New);
    let mut buffer = Vec::new();
    assert_eq!(next(&mut reader, &mut buffer), Read::PublisherDown);
    let again = LegacyPublisher {
        raw: Raw::open(&topic).unwrap(),
        slot_size: 64,
    };
    again.publish(b"again");
    assert_eq!(next(&mut reader, &mut buffer), Read::PublisherUp);
    assert_eq!(next_message(&mut reader, &mut buffer), (0, 0));
}

#[test]
fn a_legacy_file_that_is_being_made_is_awaited() {
    let topic = Scratch::new();
    let file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(topic.path())
        .unwrap();
    let mut subscriber = subscriber(&topic, Start::New);
    let mut buffer = Vec::new();
    assert_eq!(subscriber.try_read(&mut buffer).unwrap(), Read::Nothing);
    drop(file);
    let sleeper = thread::spawn(move || {
        let first = subscriber.read_timeout(&mut buffer, LONG).unwrap();
        (first, next_message(&mut subscriber, &mut buffer))
    });
    let legacy = LegacyPublisher::create(&topic, 4096);
    legacy.publish(b"first");
    assert_eq!(sleeper.join().unwrap(), (Read::PublisherUp, (0, 0)));
}

#[test]
fn a_lease_on_a_topic_of_a_legacy_publisher_is_a_copy() {
    let topic = Scratch::new();
    let legacy = LegacyPublisher::create(&topic, 4096);
    let mut subscriber = subscriber(&topic, Start::New);
    legacy.publish(b"held");
    let Received::Message(meta, lease) = subscriber.try_lease().unwrap() else {
        panic!("no message");
    };
    for _ in 0..10 {
        legacy.publish(b"lapped");
    }
    assert_eq!((meta.sequence, lease.holds_slot()), (0, false));
    assert_eq!(lease.to_vec(), b"held");
    assert_eq!(legacy.raw.u32(144).load(Relaxed), 0);
}
