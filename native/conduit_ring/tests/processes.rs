//! Real processes and real SIGKILLs.
#![cfg(not(loom))]

mod support;

use std::time::Duration;

use conduit_ring::{
    Geometry, Info, Publisher, PublisherOptions, Read, Start, State, Subscriber,
    SubscriberOptions, Topic,
};
use support::{
    Helper, Raw, Scratch, next, next_message, proven_number, proving_message, report_ready, role,
};

/// The program of a helper process; not a test.
#[test]
fn child() {
    match role() {
        None => {}
        Some((role, topic)) if role == "publisher" => publish_for_ever(&topic),
        Some((role, topic)) if role == "restless publisher" => come_and_go(&topic),
        Some((role, topic)) if role == "restless reader" => claim_and_leave(&topic),
        Some((role, topic)) if role == "restful publisher" => {
            let _publisher = Publisher::open(&topic, &options()).unwrap();
            report_ready();
            std::thread::sleep(Duration::MAX);
        }
        Some((_, topic)) => read_for_ever(&topic),
    }
}

fn options() -> PublisherOptions {
    PublisherOptions {
        geometry: Geometry::slots(4, 8192).unwrap(),
        ..Default::default()
    }
}

fn publish_for_ever(topic: &Topic) {
    let mut publisher = Publisher::open(topic, &options()).unwrap();
    report_ready();
    loop {
        let n = publisher.next_sequence();
        let len = n.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 51;
        assert_eq!(
            publisher.publish(&proving_message(n, (len as usize).min(8172))),
            Ok(n)
        );
    }
}

fn read_for_ever(topic: &Topic) {
    let mut subscriber = Subscriber::open(topic, &SubscriberOptions::default()).unwrap();
    report_ready();
    let mut buffer = Vec::new();
    loop {
        next_message(&mut subscriber, &mut buffer);
        proven_number(&buffer).unwrap();
    }
}

fn come_and_go(topic: &Topic) {
    report_ready();
    loop {
        let mut publisher = Publisher::open(topic, &options()).unwrap();
        assert!(publisher.publish(b"here").is_ok());
    }
}

fn claim_and_leave(topic: &Topic) {
    report_ready();
    loop {
        drop(Subscriber::open(topic, &SubscriberOptions::default()).unwrap());
    }
}

#[test]
fn a_killed_publisher_is_succeeded_in_place_and_its_subscribers_read_on() {
    let topic = Scratch::new();
    let mut helper = Helper::start("publisher", &topic);
    let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let first = Info::read(&topic).unwrap();
    let mut buffer = Vec::new();
    let mut expected = None;
    for epoch in 0..12 {
        for _ in 0..500 {
            let (n, lost) = next_message(&mut subscriber, &mut buffer);
            assert_eq!(proven_number(&buffer), Ok(n));
            assert!(
                expected.is_none_or(|expected| expected + lost == n),
                "{n} after {expected:?}, {lost} lost"
            );
            expected = Some(n + 1);
        }
        helper.kill();
        let info = Info::read(&topic).unwrap();
        assert_eq!(
            (info.epoch, info.instance_id, info.state),
            (epoch, first.instance_id, State::Dead)
        );
        helper = Helper::start("publisher", &topic);
    }
    assert_eq!(Info::read(&topic).unwrap().readers.len(), 1);
}

#[test]
fn death_and_return_of_a_publisher_are_reported_after_its_last_message() {
    let topic = Scratch::new();
    let helper = Helper::start("publisher", &topic);
    let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let mut buffer = Vec::new();
    let (mut last, _) = next_message(&mut subscriber, &mut buffer);
    helper.kill();
    let published = Info::read(&topic).unwrap().published;
    while let Read::Message(meta) = next(&mut subscriber, &mut buffer) {
        last = meta.sequence;
    }
    assert_eq!(last, published - 1);
    assert!(!subscriber.publisher_up());
    let mut successor = Publisher::open(&topic, &options()).unwrap();
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherUp);
    assert_eq!(successor.publish(b"again"), Ok(published));
    let Read::Message(meta) = next(&mut subscriber, &mut buffer) else {
        panic!("no message");
    };
    assert_eq!(meta.sequence, published);
}

#[test]
fn a_half_written_slot_is_rejected_for_ever() {
    let topic = Scratch::new();
    let helper = Helper::start("publisher", &topic);
    while Info::read(&topic).unwrap().published < 4 {}
    helper.kill();
    let published = Info::read(&topic).unwrap().published;
    // As if it had been killed a little later, while it wrote a message, before any of its stores
    // to the slot's sequence became visible.
    let raw = Raw::open(&topic).unwrap();
    raw.u64(72)
        .store(published + 1, std::sync::atomic::Ordering::Relaxed);
    raw.write(1216 + (published as usize & 3) * 8192 + 20, &[0xEE; 100]);
    let history = SubscriberOptions {
        start: Start::History(4),
        ..Default::default()
    };
    let mut subscriber = Subscriber::open(&topic, &history).unwrap();
    let mut buffer = Vec::new();
    assert_eq!(
        next_message(&mut subscriber, &mut buffer),
        (published - 3, 1)
    );
    assert_eq!(proven_number(&buffer), Ok(published - 3));
}

#[test]
fn a_torn_message_is_never_accepted_from_a_publisher_that_laps() {
    let topic = Scratch::new();
    let _helper = Helper::start("publisher", &topic);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                let mut subscriber =
                    Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
                let mut buffer = Vec::new();
                while subscriber.stats().delivered < 5_000 || subscriber.stats().lost < 500 {
                    let (n, _) = next_message(&mut subscriber, &mut buffer);
                    assert_eq!(proven_number(&buffer), Ok(n));
                }
            });
        }
    });
}

#[test]
fn slots_of_killed_subscribers_are_reclaimed() {
    let topic = Scratch::new();
    let mut publisher = Publisher::open(&topic, &options()).unwrap();
    for round in 0..8 {
        let helpers: Vec<Helper> = (0..3).map(|_| Helper::start("reader", &topic)).collect();
        assert_eq!(
            publisher
                .info()
                .readers
                .iter()
                .filter(|reader| reader.alive)
                .count(),
            3
        );
        for _ in 0..50 {
            let n = publisher.next_sequence();
            publisher.publish(&proving_message(n, 1000)).unwrap();
        }
        helpers.into_iter().for_each(Helper::kill);
        assert!(
            publisher.info().readers.iter().all(|reader| !reader.alive),
            "round {round}"
        );
    }
    let open = |_| Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let sixteen: Vec<Subscriber> = (0..16).map(open).collect();
    assert_eq!(publisher.info().readers.len(), 16);
    drop(sixteen);
    assert_eq!(publisher.info().readers, []);
}

#[test]
fn a_reader_killed_in_its_sleep_does_not_cost_a_wake_up_for_ever() {
    let topic = Scratch::new();
    let mut publisher = Publisher::open(&topic, &options()).unwrap();
    let sleeper = Helper::start("reader", &topic);
    while !publisher.info().readers[0].waiting {
        std::thread::sleep(Duration::from_millis(1));
    }
    sleeper.kill();
    // It may have been killed between two sleeps; then no bit is left.
    for n in 0..200 {
        assert_eq!(publisher.publish(b"x"), Ok(n));
    }
    let wakes = publisher.info().wake_count;
    assert!(wakes <= 100, "{wakes}");
    publisher.publish(b"x").unwrap();
    assert_eq!(publisher.info().wake_count, wakes);
}

#[test]
fn a_publisher_killed_at_any_instant_leaves_a_topic_that_the_next_one_can_open() {
    let topic = Scratch::new();
    let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let mut buffer = Vec::new();
    for _ in 0..20 {
        let helper = Helper::start("restless publisher", &topic);
        next_message(&mut subscriber, &mut buffer);
        helper.kill();
        let mut publisher = Publisher::open(&topic, &options()).unwrap();
        let n = publisher.publish(b"and on").unwrap();
        while buffer != b"and on" {
            next_message(&mut subscriber, &mut buffer);
        }
        assert_eq!(n, publisher.next_sequence() - 1);
    }
}

#[test]
fn readers_killed_while_they_claim_and_leave_leak_no_slot() {
    let topic = Scratch::new();
    let publisher = Publisher::open(&topic, &options()).unwrap();
    for _ in 0..20 {
        let helpers: Vec<Helper> = (0..2)
            .map(|_| Helper::start("restless reader", &topic))
            .collect();
        helpers.into_iter().for_each(Helper::kill);
    }
    let open = |_| Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let sixteen: Vec<Subscriber> = (0..16).map(open).collect();
    assert_eq!(publisher.info().readers.len(), 16);
    drop(sixteen);
    assert_eq!(publisher.info().readers, []);
}

#[test]
fn a_takeover_wakes_a_subscriber_that_sleeps() {
    let topic = Scratch::new();
    let helper = Helper::start("restful publisher", &topic);
    let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    assert!(subscriber.publisher_up());
    helper.kill();
    let mut buffer = Vec::new();
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherDown);
    let sleeper = std::thread::spawn(move || {
        let read = next(&mut subscriber, &mut buffer);
        (read, next_message(&mut subscriber, &mut buffer))
    });
    while !Info::read(&topic).unwrap().readers[0].waiting {
        std::thread::yield_now();
    }
    let mut successor = Publisher::open(&topic, &options()).unwrap();
    successor.publish(b"again").unwrap();
    assert_eq!(sleeper.join().unwrap(), (Read::PublisherUp, (0, 0)));
}
