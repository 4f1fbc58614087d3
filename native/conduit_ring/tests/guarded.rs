//! Subscribers that no other process can kill by shortening the file.
#![cfg(not(loom))]

mod support;

use std::os::unix::fs::chown;
use std::process::Command;
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use std::time::{Duration, Instant};

use conduit_ring::{
    Error, Fault, Geometry, Guard, Observer, ObserverOptions, Publisher, PublisherOptions, Read,
    Received, Start, Subscriber, SubscriberOptions, Topic, Wait,
};
use support::{
    Helper, LONG, Raw, Scratch, next, next_message, proven_number, proving_message, report_ready,
    role,
};

const WAITING_MASK: usize = 140;

/// The program of a helper process; not a test.
#[test]
fn child() {
    match role() {
        None => {}
        Some((role, topic)) if role == "publisher" => publish_for_ever(&topic),
        Some((role, topic)) if role == "quiet publisher" => {
            let _publisher = publisher(&topic);
            report_ready();
            thread::sleep(Duration::MAX);
        }
        Some((_, topic)) => {
            let mut subscriber = guarded(&topic);
            report_ready();
            loop {
                next(&mut subscriber, &mut Vec::new());
            }
        }
    }
}

fn publisher(topic: &Topic) -> Publisher {
    let options = PublisherOptions {
        geometry: Geometry::slots(4, 8192).unwrap(),
        ..Default::default()
    };
    Publisher::open(topic, &options).unwrap()
}

fn publish_for_ever(topic: &Topic) {
    let mut publisher = publisher(topic);
    report_ready();
    loop {
        let n = publisher.next_sequence();
        let len = (n.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 51) as usize;
        publisher
            .publish(&proving_message(n, len.min(8172)))
            .unwrap();
    }
}

fn guarded(topic: &Topic) -> Subscriber {
    let options = SubscriberOptions {
        guard: Guard::Always,
        ..Default::default()
    };
    Subscriber::open(topic, &options).unwrap()
}

/// Shortens the file from another process.
fn truncate(topic: &Topic, len: usize) {
    let done = Command::new("truncate")
        .arg(format!("--size={len}"))
        .arg(topic.path())
        .status()
        .unwrap();
    assert!(done.success());
}

/// Reads until the file turns out to be broken (`Some`) or its publisher to have ended.
fn read_to_the_break(subscriber: &mut Subscriber) -> Option<Error> {
    let (mut buffer, deadline) = (Vec::new(), Instant::now() + LONG);
    loop {
        match subscriber.read_timeout(&mut buffer, LONG) {
            Ok(Read::Message(meta)) => assert_eq!(proven_number(&buffer), Ok(meta.sequence)),
            Ok(Read::PublisherDown) => return None,
            Ok(_) => {}
            Err(error) => return Some(error),
        }
        assert!(Instant::now() < deadline, "nothing was noticed");
    }
}

#[test]
fn a_guarded_subscriber_reads_whole_messages_of_a_publisher_that_laps() {
    let topic = Scratch::new();
    let _helper = Helper::start("publisher", &topic);
    let mut subscriber = guarded(&topic);
    let mut buffer = Vec::new();
    while subscriber.stats().delivered < 2_000 {
        let (n, _) = next_message(&mut subscriber, &mut buffer);
        assert_eq!(proven_number(&buffer), Ok(n));
    }
}

#[test]
fn a_guarded_subscriber_sleeps_is_woken_and_does_not_show() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = guarded(&topic);
    assert_eq!(publisher.info().readers, []);
    let waker = subscriber.waker();
    let raw = Raw::open(&topic).unwrap();
    let await_sleep = || {
        while raw.u32(WAITING_MASK).load(Relaxed) == 0 {
            thread::yield_now();
        }
    };
    // A sleep that ends by itself at that moment does not count as woken.
    while publisher.info().wake_count == 0 {
        thread::scope(|scope| {
            let sleeper = scope.spawn(|| next_message(&mut subscriber, &mut Vec::new()));
            await_sleep();
            let n = publisher.publish(b"wake up").unwrap();
            assert_eq!(sleeper.join().unwrap(), (n, 0));
        });
    }
    thread::scope(|scope| {
        let sleeper = scope.spawn(|| subscriber.wait(LONG).unwrap());
        await_sleep();
        waker.wake();
        assert_eq!(sleeper.join().unwrap(), Wait::Woken);
    });
    drop(subscriber);
    let wakes = publisher.info().wake_count;
    publisher.publish(b"unseen").unwrap();
    assert_eq!(publisher.info().wake_count, wakes);
}

#[test]
fn a_guarded_reader_killed_in_its_sleep_does_not_cost_a_wake_up_for_ever() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let sleeper = Helper::start("guarded reader", &topic);
    let raw = support::Raw::open(&topic).unwrap();
    while raw.u32(140).load(std::sync::atomic::Ordering::Relaxed) == 0 {
        thread::yield_now();
    }
    sleeper.kill();
    (0..200).for_each(|_| assert!(publisher.publish(b"x").is_ok()));
    let wakes = publisher.info().wake_count;
    assert!(wakes <= 100, "{wakes}");
    publisher.publish(b"x").unwrap();
    assert_eq!(publisher.info().wake_count, wakes);
}

#[test]
fn another_users_topic_is_guarded_automatically() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    if chown(topic.path(), Some(65_534), None).is_err() {
        eprintln!("only root can give a file away: not tested");
        return;
    }
    let shown = |guard| {
        let options = SubscriberOptions {
            guard,
            ..Default::default()
        };
        let mut subscriber = Subscriber::open(&topic, &options).unwrap();
        let n = publisher.publish(b"for all").unwrap();
        assert_eq!(next_message(&mut subscriber, &mut Vec::new()), (n, 0));
        publisher.info().readers.len()
    };
    let mut shown = shown;
    assert_eq!((shown(Guard::Auto), shown(Guard::Never)), (0, 1));
}

#[test]
fn a_lease_in_guarded_mode_is_a_copy() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = guarded(&topic);
    publisher.publish(b"held").unwrap();
    let Received::Message(_, lease) = subscriber.try_lease().unwrap() else {
        panic!("no message");
    };
    (0..8).for_each(|_| assert!(publisher.publish(b"over it").is_ok()));
    assert!(!lease.holds_slot());
    assert_eq!(lease.to_vec(), b"held");
}

#[test]
fn a_file_that_is_cut_off_under_a_guarded_reader_is_noticed_without_a_signal() {
    for len in [0, 100, 1216, 1300, 10_000, 4 * 8192] {
        let topic = Scratch::new();
        let _helper = Helper::start("publisher", &topic);
        let mut subscriber = guarded(&topic);
        let mut buffer = Vec::new();
        for _ in 0..20 {
            next_message(&mut subscriber, &mut buffer);
        }
        let end = thread::scope(|scope| {
            let reader = scope.spawn(|| read_to_the_break(&mut subscriber));
            truncate(&topic, len);
            reader.join().unwrap()
        });
        assert!(
            matches!(
                end,
                None | Some(Error::BadSegment {
                    fault: Fault::Truncated | Fault::NotReady,
                    ..
                })
            ),
            "{len}: {end:?}"
        );
    }
}

#[test]
fn a_file_that_is_cut_off_under_a_guarded_sleeper_is_noticed_without_a_signal() {
    for len in [0, 1216] {
        let topic = Scratch::new();
        let _helper = Helper::start("quiet publisher", &topic);
        let mut subscriber = guarded(&topic);
        assert_eq!(
            subscriber.wait(Duration::from_millis(10)).unwrap(),
            Wait::TimedOut
        );
        let waker = subscriber.waker();
        let found = thread::scope(|scope| {
            let sleeper = scope.spawn(|| {
                loop {
                    // A waker ends the wait without a message.
                    match subscriber.read_timeout(&mut Vec::new(), LONG) {
                        Ok(Read::Nothing) => {}
                        found => return found,
                    }
                }
            });
            truncate(&topic, len);
            waker.wake();
            sleeper.join().unwrap()
        });
        assert!(
            matches!(
                found,
                Ok(Read::PublisherDown) | Err(Error::BadSegment { .. })
            ),
            "{found:?}"
        );
        assert!(!subscriber.publisher_up());
    }
}

#[test]
fn a_file_that_is_cut_off_under_a_guarded_observer_is_noticed_without_a_signal() {
    let topic = Scratch::new();
    let _helper = Helper::start("publisher", &topic);
    let options = ObserverOptions {
        guard: Guard::Always,
        start: Start::Latest,
        ..Default::default()
    };
    let mut observer = Observer::open(&topic, &options).unwrap();
    let (mut buffer, mut cut) = (Vec::new(), false);
    let error = loop {
        match observer.read_timeout(&mut buffer, LONG) {
            Ok(Read::Message(meta)) => assert_eq!(proven_number(&buffer), Ok(meta.sequence)),
            Ok(_) => {}
            Err(error) => break error,
        }
        if !cut {
            truncate(&topic, 0);
            cut = true;
        }
    };
    assert!(matches!(error, Error::BadSegment { .. }), "{error}");
}

#[test]
fn a_guarded_subscriber_follows_its_topic_into_the_next_life() {
    let topic = Scratch::new();
    let mut first = publisher(&topic);
    let mut subscriber = guarded(&topic);
    let mut buffer = Vec::new();
    first.publish(b"last words").unwrap();
    first.close();
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherDown);
    let mut second = publisher(&topic);
    second.publish(b"first words").unwrap();
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherUp);
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    assert_eq!(buffer, b"first words");
}

#[test]
fn a_topic_takes_sixteen_guarded_subscribers() {
    let topic = Scratch::new();
    let _publisher = publisher(&topic);
    let _all: Vec<_> = (0..16).map(|_| guarded(&topic)).collect();
    let options = SubscriberOptions {
        guard: Guard::Always,
        ..Default::default()
    };
    let refused = Subscriber::open(&topic, &options).unwrap_err();
    assert!(matches!(refused, Error::NoReaderSlot { .. }), "{refused}");
    let refused = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap_err();
    assert!(matches!(refused, Error::NoReaderSlot { .. }), "{refused}");
}
