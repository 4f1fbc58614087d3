//! Observers read as subscribers do, and leave no trace.
#![cfg(not(loom))]

mod support;

use std::thread;
use std::time::Duration;

use conduit_ring::{
    Geometry, Info, Observer, ObserverOptions, Publisher, PublisherOptions, Read, Start, Topic,
};
use support::{Helper, LONG, Scratch, proven_number, proving_message, report_ready, role};

/// The program of the process that the tests start: it publishes until it is killed.
#[test]
fn child() {
    let Some((role, topic)) = role() else { return };
    assert_eq!(role, "publish");
    let mut publisher = open(&topic);
    report_ready();
    loop {
        let n = publisher.next_sequence();
        publisher.publish(&proving_message(n, 64)).unwrap();
        thread::sleep(Duration::from_millis(1));
    }
}

fn open(topic: &Topic) -> Publisher {
    let options = PublisherOptions {
        geometry: Geometry::depth(8, 1000).unwrap(),
        ..PublisherOptions::default()
    };
    Publisher::open(topic, &options).unwrap()
}

fn observe(topic: &Topic, start: Start) -> Observer {
    let options = ObserverOptions {
        start,
        ..ObserverOptions::default()
    };
    Observer::open(topic, &options).unwrap()
}

/// Returns the next message or change.
fn next(observer: &mut Observer, buffer: &mut Vec<u8>) -> Read {
    match observer.read_timeout(buffer, LONG).unwrap() {
        Read::Nothing => panic!("nothing for {LONG:?}"),
        read => read,
    }
}

fn next_number(observer: &mut Observer, buffer: &mut Vec<u8>) -> u64 {
    loop {
        if let Read::Message(meta) = next(observer, buffer) {
            assert_eq!(proven_number(buffer), Ok(meta.sequence));
            return meta.sequence;
        }
    }
}

#[test]
fn any_number_of_observers_see_every_message_and_leave_no_trace() {
    let topic = Scratch::new();
    let mut publisher = open(&topic);
    let mut observers: Vec<_> = (0..40).map(|_| observe(&topic, Start::New)).collect();
    for n in 0..5 {
        publisher.publish(&proving_message(n, 200)).unwrap();
    }
    let mut buffer = Vec::new();
    for observer in &mut observers {
        let numbers: Vec<_> = (0..5).map(|_| next_number(observer, &mut buffer)).collect();
        assert_eq!(numbers, [0, 1, 2, 3, 4]);
        assert_eq!(observer.try_read(&mut buffer).unwrap(), Read::Nothing);
    }
    let info = publisher.info();
    assert_eq!((info.readers, info.wake_count), (vec![], 0));
}

#[test]
fn an_observer_that_falls_behind_counts_its_losses() {
    let topic = Scratch::new();
    let mut publisher = open(&topic);
    let mut observer = observe(&topic, Start::New);
    for n in 0..20 {
        publisher.publish(&proving_message(n, 200)).unwrap();
    }
    let read = next(&mut observer, &mut Vec::new());
    assert!(matches!(read, Read::Message(meta) if (meta.sequence, meta.lost) == (12, 12)));
    assert_eq!(observer.stats().lost, 12);
}

#[test]
fn an_observer_without_company_sees_a_message_within_its_nap() {
    let topic = Scratch::new();
    let mut publisher = open(&topic);
    let mut observer = observe(&topic, Start::New);
    let watching = thread::spawn(move || next_number(&mut observer, &mut Vec::new()));
    publisher.publish(&proving_message(0, 200)).unwrap();
    assert_eq!(watching.join().unwrap(), 0);
}

#[test]
fn an_observer_waits_for_a_topic_and_sees_it_from_its_first_message() {
    let topic = Scratch::new();
    let mut observer = observe(&topic, Start::New);
    assert_eq!(observer.incarnation(), None);
    let mut publisher = open(&topic);
    publisher.publish(&proving_message(0, 200)).unwrap();
    let mut buffer = Vec::new();
    assert_eq!(next(&mut observer, &mut buffer), Read::PublisherUp);
    assert_eq!(next_number(&mut observer, &mut buffer), 0);
    assert_eq!(observer.incarnation().unwrap().pid, std::process::id());
    drop(publisher);
    assert_eq!(next(&mut observer, &mut buffer), Read::PublisherDown);
}

#[test]
fn an_observer_continues_when_its_publisher_is_killed_and_started_again() {
    let topic = Scratch::new();
    let first = Helper::start("publish", &topic);
    let mut observer = observe(&topic, Start::New);
    let mut buffer = Vec::new();
    let last = next_number(&mut observer, &mut buffer);
    let before = observer.incarnation().unwrap();

    first.kill();
    while next(&mut observer, &mut buffer) != Read::PublisherDown {}
    let _second = Helper::start("publish", &topic);
    assert_eq!(next(&mut observer, &mut buffer), Read::PublisherUp);
    assert!(next_number(&mut observer, &mut buffer) > last);

    let after = observer.incarnation().unwrap();
    assert_eq!(
        (after.instance_id, after.epoch),
        (before.instance_id, before.epoch + 1)
    );
    assert_ne!(after.pid, before.pid);
    assert_eq!(Info::read(&topic).unwrap().readers, []);
}
