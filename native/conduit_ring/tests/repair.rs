//! What tools may repair in the files that crashes left, and what they must leave alone.
#![cfg(not(loom))]

mod support;

use std::fs;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Mutex, MutexGuard, PoisonError};

use conduit_ring::repair::{Repair, clear_legacy_readers, reclaim_readers, remove_abandoned};
use conduit_ring::{
    Error, Info, Listing, Publisher, PublisherOptions, Subscriber, SubscriberOptions,
};
use support::{Helper, Raw, Scratch, report_ready, role};

const SUBSCRIBER_MASK: usize = 128;

/// The program of the process that the tests start and kill.
#[test]
fn child() {
    let Some((role, topic)) = role() else { return };
    let _publisher = (role == "publish")
        .then(|| Publisher::open(&topic, &PublisherOptions::default()).unwrap());
    let _subscriber = (role == "subscribe")
        .then(|| Subscriber::open(&topic, &SubscriberOptions::default()).unwrap());
    report_ready();
    loop {
        std::thread::park();
    }
}

#[test]
fn the_file_of_a_killed_publisher_is_removed() {
    let (_alone, topic) = (one_at_a_time(), Scratch::new());
    Helper::start("publish", &topic).kill();
    assert!(Listing::read().unwrap().topics.contains(&topic));
    assert_eq!(remove_abandoned(&topic).unwrap(), Repair::Made);
    assert!(matches!(Info::read(&topic), Err(Error::NoTopic { .. })));
    assert!(!Listing::read().unwrap().topics.contains(&topic));
    assert_eq!(remove_abandoned(&topic).unwrap(), Repair::NotNeeded);
}

#[test]
fn the_file_of_a_live_publisher_is_left_alone() {
    let (_alone, topic) = (one_at_a_time(), Scratch::new());
    let _publisher = Helper::start("publish", &topic);
    assert_eq!(remove_abandoned(&topic).unwrap(), Repair::PublisherAlive);
    assert_eq!(
        clear_legacy_readers(&topic).unwrap(),
        Repair::PublisherAlive
    );
}

#[test]
fn a_file_that_a_process_has_open_is_left_alone() {
    let (_alone, topic) = (one_at_a_time(), Scratch::new());
    let publisher = Helper::start("publish", &topic);
    let subscriber = Helper::start("subscribe", &topic);
    publisher.kill();
    assert_eq!(remove_abandoned(&topic).unwrap(), Repair::InUse);
    assert_eq!(clear_legacy_readers(&topic).unwrap(), Repair::InUse);
    subscriber.kill();
    assert_eq!(remove_abandoned(&topic).unwrap(), Repair::Made);
}

#[test]
fn slots_of_killed_readers_are_taken_back_from_a_live_topic() {
    let (_alone, topic) = (one_at_a_time(), Scratch::new());
    let publisher = Publisher::open(&topic, &PublisherOptions::default()).unwrap();
    let _living = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let readers: Vec<_> = (0..3).map(|_| Helper::start("subscribe", &topic)).collect();
    readers.into_iter().for_each(Helper::kill);
    assert_eq!(publisher.info().readers.len(), 4);
    assert_eq!(reclaim_readers(&topic).unwrap(), 3);
    assert_eq!(publisher.info().readers.len(), 1);
    assert_eq!(reclaim_readers(&topic).unwrap(), 0);
}

#[test]
fn bits_of_legacy_readers_are_cleared_once_no_process_has_the_file() {
    let (_alone, topic) = (one_at_a_time(), Scratch::new());
    let publisher = Helper::start("publish", &topic);
    let raw = Raw::open(&topic).unwrap();
    raw.u32(SUBSCRIBER_MASK).fetch_or(0b101, Relaxed);
    publisher.kill();
    assert_eq!(clear_legacy_readers(&topic).unwrap(), Repair::InUse);
    drop(raw);
    assert_eq!(clear_legacy_readers(&topic).unwrap(), Repair::Made);
    assert_eq!(Info::read(&topic).unwrap().readers, []);
    assert_eq!(clear_legacy_readers(&topic).unwrap(), Repair::NotNeeded);
}

#[test]
fn a_file_that_never_was_a_ring_is_left_alone() {
    let (_alone, topic) = (one_at_a_time(), Scratch::new());
    fs::write(topic.path(), "buy milk").unwrap();
    assert_eq!(remove_abandoned(&topic).unwrap(), Repair::NotARing);
    fs::write(topic.path(), "").unwrap();
    assert_eq!(remove_abandoned(&topic).unwrap(), Repair::Made);
}

/// Lets one test run at a time. A child that another test is starting shares the files of this
/// process and their locks, also those that were just closed, until it runs its own program.
fn one_at_a_time() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}
