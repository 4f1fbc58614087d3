//! Messages that are read in their slots, and written there.
#![cfg(not(loom))]

mod support;

use std::io::Write;
use std::sync::atomic::Ordering::Relaxed;
use std::thread;
use std::time::Instant;

use conduit_ring::{
    Error, Geometry, Info, Lease, Meta, PublishError, Publisher, PublisherOptions, Received,
    Start, Subscriber, SubscriberOptions, Topic,
};
use support::{
    Helper, LONG, Raw, Scratch, next_message, proven_number, proving_message, report_ready, role,
};

/// The program of a helper process; not a test.
#[test]
fn child() {
    match role() {
        None => {}
        Some((role, topic)) if role == "holder" => {
            let mut subscriber = subscriber(&topic, Start::Latest);
            let _lease = lease(&mut subscriber);
            report_ready();
            thread::sleep(std::time::Duration::MAX);
        }
        Some((role, topic)) if role == "holder of the next" => {
            let mut subscriber = subscriber(&topic, Start::New);
            report_ready();
            // The first may be a copy.
            let _lease = loop {
                let (_, lease) = lease(&mut subscriber);
                if lease.holds_slot() {
                    break lease;
                }
            };
            thread::sleep(std::time::Duration::MAX);
        }
        Some((_, topic)) => publish_for_ever(&topic),
    }
}

fn options() -> PublisherOptions {
    PublisherOptions {
        geometry: Geometry::slots(4, 8192).unwrap(),
        ..Default::default()
    }
}

fn publisher(topic: &Topic) -> Publisher {
    Publisher::open(topic, &options()).unwrap()
}

fn subscriber(topic: &Topic, start: Start) -> Subscriber {
    let options = SubscriberOptions {
        start,
        ..Default::default()
    };
    Subscriber::open(topic, &options).unwrap()
}

fn publish_for_ever(topic: &Topic) {
    let mut publisher = publisher(topic);
    report_ready();
    loop {
        // The messages go behind the held slots.
        let Ok(n) = publisher.loan(0).map(|loan| loan.sequence()) else {
            continue;
        };
        let len = (n.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 51) as usize;
        let message = proving_message(n, len.min(8172));
        if n.is_multiple_of(2) {
            assert_eq!(publisher.publish(&message), Ok(n));
        } else {
            let mut loan = publisher.loan(message.len()).unwrap();
            loan.write_all(&message).unwrap();
            assert_eq!(loan.commit(), n);
        }
    }
}

fn publish_times(times: u32, publisher: &mut Publisher, message: &[u8]) {
    (0..times).for_each(|_| assert!(publisher.publish(message).is_ok()));
}

fn lease(subscriber: &mut Subscriber) -> (Meta, Lease) {
    loop {
        match subscriber.try_lease().unwrap() {
            Received::Message(meta, lease) => return (meta, lease),
            Received::Nothing => drop(subscriber.wait(LONG).unwrap()),
            Received::PublisherUp | Received::PublisherDown => {}
        }
    }
}

/// Returns a subscriber whose publisher knows that it uses leases: its first one is over.
fn leasing(topic: &Topic, publisher: &mut Publisher) -> Subscriber {
    let mut subscriber = subscriber(topic, Start::New);
    publisher.publish(b"first").unwrap();
    drop(lease(&mut subscriber));
    subscriber
}

/// Publishes on a ring of four slots of which one is held. Returns the numbers of the messages.
fn publish_around(times: u64, publisher: &mut Publisher) -> Vec<u64> {
    (0..times)
        .map(|_| publisher.publish(b"next").unwrap())
        .collect()
}

#[test]
fn a_held_slot_is_passed_over_with_its_number_and_its_message_stays() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = leasing(&topic, &mut publisher);
    publisher.publish(b"held").unwrap();
    let (meta, lease) = lease(&mut subscriber);
    assert!(lease.holds_slot());
    assert_eq!((meta.sequence, meta.len, lease.len()), (1, 4, 4));
    let reader = publisher.info().readers.remove(0);
    assert_eq!((reader.leases, reader.held), (1, vec![1]));
    assert_eq!(
        publish_around(9, &mut publisher),
        [2, 3, 4, 6, 7, 8, 10, 11, 12]
    );
    assert_eq!(publisher.loan(7).unwrap().commit(), 14);
    assert_eq!(lease.to_vec(), b"held");
    assert_eq!(publisher.info().dropped_pinned, 3);
    drop(lease);
    assert_eq!(publish_around(4, &mut publisher), [15, 16, 17, 18]);
    let info = publisher.info();
    assert_eq!((info.dropped_pinned, info.readers[0].leases), (3, 0));
}

#[test]
fn a_reader_that_holds_slots_stops_no_other_reader_and_costs_them_counted_messages() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut other = subscriber(&topic, Start::New);
    let holder = Helper::start("holder of the next", &topic);
    while publisher.info().readers.iter().all(|r| r.leases == 0) {
        publisher.publish(b"to be held").unwrap();
    }
    let pid = holder.pid();
    // SAFETY: the helper is a child of this process that has not been waited for.
    assert_eq!(unsafe { libc::kill(pid as i32, libc::SIGSTOP) }, 0);
    let mut buffer = Vec::new();
    while other.try_read(&mut buffer).unwrap() != conduit_ring::Read::Nothing {}
    let before = other.stats();
    for _ in 0..300 {
        let n = publisher.publish(b"next").unwrap();
        assert_eq!(next_message(&mut other, &mut buffer).0, n);
        assert_eq!(buffer, b"next");
    }
    let lost = other.stats().lost - before.lost;
    assert_eq!(other.stats().delivered - before.delivered, 300);
    assert_eq!(publisher.info().dropped_pinned, lost);
    assert!((99..=101).contains(&lost), "every fourth number: {lost}");
    let info = Info::read(&topic).unwrap();
    let holders: Vec<_> = info.readers.iter().filter(|r| r.leases > 0).collect();
    assert_eq!(holders.iter().map(|r| r.pid).collect::<Vec<_>>(), [pid]);
    assert!(info.published - holders[0].held[0] >= 400, "{holders:?}");
}

#[test]
fn a_message_is_dropped_and_counted_once_all_slots_are_held() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut readers = [0, 1].map(|_| subscriber(&topic, Start::New));
    publisher.publish(b"first").unwrap();
    readers.iter_mut().for_each(|reader| drop(lease(reader)));
    let mut leases = Vec::new();
    for n in 0..4 {
        publisher.publish(b"held").unwrap();
        let (left, right) = (lease(&mut readers[0]).1, lease(&mut readers[1]).1);
        leases.push(if n % 2 == 0 { left } else { right });
    }
    let before = publisher.info();
    assert_eq!((before.published, before.dropped_pinned), (5, 0));
    for _ in 0..20 {
        assert_eq!(publisher.publish(b"dropped"), Err(PublishError::SlotHeld));
        assert!(matches!(publisher.loan(7), Err(PublishError::SlotHeld)));
    }
    assert!(leases.iter().all(|lease| lease.to_vec() == b"held"));
    let after = publisher.info();
    assert_eq!((after.published, after.dropped_pinned), (5, 40));
    leases.remove(2);
    // The slots of messages 1, 2 and 4 are held; that of 3 is free.
    assert_eq!(publish_around(2, &mut publisher), [7, 11]);
}

#[test]
fn other_readers_read_a_held_message_until_its_slot_is_passed_over() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut holder = leasing(&topic, &mut publisher);
    publisher.publish(b"held").unwrap();
    let (_, lease) = lease(&mut holder);
    publish_times(3, &mut publisher, b"another");
    let history = |topic: &Topic| {
        let mut other = subscriber(topic, Start::History(4));
        let mut buffer = Vec::new();
        (next_message(&mut other, &mut buffer), buffer)
    };
    assert_eq!(history(&topic), ((1, 0), lease.to_vec()));
    publish_times(1, &mut publisher, b"behind it");
    // Number 5 is the one that was passed over.
    assert_eq!(history(&topic), ((3, 0), b"another".to_vec()));
    let mut late = subscriber(&topic, Start::History(2));
    assert_eq!(next_message(&mut late, &mut Vec::new()), (6, 1));
}

#[test]
fn the_newest_message_is_found_behind_a_number_that_was_passed_over() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut holder = leasing(&topic, &mut publisher);
    publisher.publish(b"held").unwrap();
    let (_, _lease) = lease(&mut holder);
    let options = SubscriberOptions {
        policy: conduit_ring::Policy::Latest,
        ..Default::default()
    };
    let mut newest = Subscriber::open(&topic, &options).unwrap();
    publish_times(3, &mut publisher, b"newest");
    // Number 5 is used up, and the message behind it is not published yet.
    let _lent = publisher.loan(4).unwrap();
    let mut buffer = Vec::new();
    assert_eq!(next_message(&mut newest, &mut buffer), (4, 2));
    assert_eq!(buffer, b"newest");
    let mut late = subscriber(&topic, Start::Latest);
    assert_eq!(next_message(&mut late, &mut buffer), (4, 0));
}

#[test]
fn an_empty_message_is_not_taken_for_a_number_that_was_passed_over() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut reader = subscriber(&topic, Start::New);
    for n in 0..9 {
        assert_eq!(publisher.publish(b""), Ok(n));
        assert_eq!(next_message(&mut reader, &mut Vec::new()), (n, 0));
    }
}

#[test]
fn a_first_lease_on_a_message_that_is_about_to_be_overwritten_is_a_copy() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = subscriber(&topic, Start::New);
    for n in 0..4_u8 {
        publisher.publish(&[n; 100]).unwrap();
    }
    let (meta, first) = lease(&mut subscriber);
    assert_eq!((meta.sequence, first.holds_slot()), (0, false));
    assert_eq!(publisher.publish(b"over it"), Ok(4));
    assert_eq!(first.to_vec(), [0; 100]);
    assert!(lease(&mut subscriber).1.holds_slot());
}

#[test]
fn three_leases_at_a_time_and_the_message_of_the_fourth_is_kept() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = leasing(&topic, &mut publisher);
    for n in 1..5 {
        assert_eq!(publisher.publish(b"x"), Ok(n));
    }
    let mut leases: Vec<_> = (0..3).map(|_| lease(&mut subscriber)).collect();
    let refused = subscriber.try_lease();
    assert!(
        matches!(refused, Err(Error::TooManyLeases { .. })),
        "{refused:?}"
    );
    assert_eq!(leases.remove(1).0.sequence, 2);
    assert_eq!(lease(&mut subscriber).0.sequence, 4);
    assert!(matches!(subscriber.try_lease(), Ok(Received::Nothing)));
}

#[test]
fn a_killed_holder_stalls_no_publisher() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    publisher.publish(b"held").unwrap();
    let helper = Helper::start("holder", &topic);
    assert_eq!(publish_around(4, &mut publisher), [1, 2, 3, 5]);
    helper.kill();
    let deadline = Instant::now() + LONG;
    while !publisher.info().readers.is_empty() {
        publisher.publish(b"next").unwrap();
        assert!(Instant::now() < deadline, "never taken back");
    }
    assert_eq!(Raw::open(&topic).unwrap().u32(144).load(Relaxed), 0);
}

#[test]
fn a_killed_holder_that_was_not_checked_before_costs_no_message() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    publisher.publish(b"held").unwrap();
    Helper::start("holder", &topic).kill();
    for n in 1..9 {
        assert_eq!(publisher.publish(b"next"), Ok(n));
    }
    assert_eq!(publisher.info().dropped_pinned, 0);
}

#[test]
fn a_loan_takes_the_slot_of_a_killed_holder_back_too() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    publisher.publish(b"held").unwrap();
    Helper::start("holder", &topic).kill();
    for n in 1..9 {
        assert_eq!(publisher.loan(0).unwrap().commit(), n);
    }
}

#[test]
fn a_successor_respects_held_messages() {
    let topic = Scratch::new();
    let mut first = publisher(&topic);
    let mut subscriber = leasing(&topic, &mut first);
    first.publish(b"held").unwrap();
    let (_, lease) = lease(&mut subscriber);
    publish_times(3, &mut first, b"another");
    first.abandon();
    let mut second = publisher(&topic);
    assert_eq!(publish_around(4, &mut second), [6, 7, 8, 10]);
    second.abandon();
    let mut third = publisher(&topic);
    assert_eq!(publish_around(3, &mut third), [11, 12, 14]);
    assert_eq!(lease.to_vec(), b"held");
    drop(lease);
    assert_eq!(publish_around(4, &mut third), [15, 16, 17, 18]);
}

#[test]
fn a_lease_outlives_its_subscriber_and_then_releases_the_reader_slot() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = leasing(&topic, &mut publisher);
    publisher.publish(b"held").unwrap();
    let (_, lease) = lease(&mut subscriber);
    drop(subscriber);
    assert_eq!(publish_around(4, &mut publisher), [2, 3, 4, 6]);
    assert_eq!(
        thread::spawn(move || lease.to_vec()).join().unwrap(),
        b"held"
    );
    assert_eq!(publisher.info().readers, []);
    assert_eq!(publish_around(4, &mut publisher), [7, 8, 9, 10]);
}

#[test]
fn a_lease_outlives_its_topic() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = leasing(&topic, &mut publisher);
    publisher.publish(b"held").unwrap();
    let (_, lease) = lease(&mut subscriber);
    publisher.close();
    assert!(matches!(
        subscriber.try_lease(),
        Ok(Received::PublisherDown)
    ));
    drop(subscriber);
    assert_eq!(lease.to_vec(), b"held");
}

#[test]
fn a_detached_lease_keeps_its_bytes_where_they_are_and_gives_the_slot_back() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = leasing(&topic, &mut publisher);
    let (mut kept, mut messages) = (Vec::new(), Vec::new());
    for round in 0..12_u64 {
        let n = publisher.next_sequence();
        let len = [0, 1, 2000, 4096, 8172][round as usize % 5];
        messages.push(vec![round as u8 + 1; len]);
        assert_eq!(publisher.publish(&messages[round as usize]), Ok(n));
        let (_, mut lease) = lease(&mut subscriber);
        let at = lease.as_ptr();
        lease.detach().unwrap();
        lease.detach().unwrap();
        assert_eq!((lease.as_ptr(), lease.holds_slot()), (at, false));
        kept.push(lease);
    }
    publish_times(50, &mut publisher, &[0xEE; 8172]);
    assert_eq!(publisher.info().readers[0].leases, 0);
    drop((publisher, subscriber));
    for (lease, message) in kept.iter().zip(&messages) {
        assert_eq!(&lease.to_vec(), message);
        // SAFETY: the pages are private, so that no process writes there.
        assert_eq!(unsafe { lease.as_slice() }, &message[..]);
    }
}

#[test]
fn a_thread_that_reads_while_a_lease_is_detached_sees_the_same_bytes() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = leasing(&topic, &mut publisher);
    for round in 1..100_u8 {
        publisher.publish(&[round; 8172]).unwrap();
        let (_, mut lease) = lease(&mut subscriber);
        let at = lease.as_ptr() as usize;
        let done = std::sync::atomic::AtomicBool::new(false);
        thread::scope(|scope| {
            scope.spawn(|| {
                while !done.load(Relaxed) {
                    for offset in (0..8172).step_by(64) {
                        let byte = std::ptr::with_exposed_provenance::<u8>(at + offset);
                        // SAFETY: inside the lease's bytes, which live until the scope ends.
                        assert_eq!(unsafe { byte.read_volatile() }, round);
                    }
                }
            });
            lease.detach().unwrap();
            publish_times(8, &mut publisher, &[0xEE; 8172]);
            while let Ok(Received::Message(..)) = subscriber.try_lease() {}
            done.store(true, Relaxed);
        });
    }
}

#[test]
fn held_messages_never_change_while_a_publisher_laps() {
    let topic = Scratch::new();
    let _helper = Helper::start("publisher", &topic);
    thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                let mut subscriber = subscriber(&topic, Start::Latest);
                let mut held = std::collections::VecDeque::new();
                for _ in 0..3_000 {
                    let (meta, lease) = lease(&mut subscriber);
                    assert_eq!(proven_number(&lease.to_vec()), Ok(meta.sequence));
                    held.push_back(lease);
                    // The two together never hold all four slots while both wait.
                    if held.len() == 2 {
                        held.iter().for_each(|lease| {
                            assert_eq!(proven_number(&lease.to_vec()), Ok(lease.meta().sequence));
                        });
                        held.pop_front();
                    }
                }
            });
        }
    });
    let info = Info::read(&topic).unwrap();
    assert!(info.dropped_pinned > 0, "{info:?}");
}

#[test]
fn a_loan_is_published_when_it_is_committed_and_not_before() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = subscriber(&topic, Start::New);
    let mut loan = publisher.loan(8172).unwrap();
    assert_eq!((loan.sequence(), loan.len()), (0, 8172));
    loan.write_at(3, b"de");
    write!(loan, "abc").unwrap();
    assert!(matches!(subscriber.try_lease(), Ok(Received::Nothing)));
    loan.truncate(5);
    assert_eq!(loan.commit(), 0);
    let mut buffer = Vec::new();
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    assert_eq!(buffer, b"abcde");
}

#[test]
fn a_loan_that_is_dropped_publishes_nothing_and_its_number_is_used_again() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = subscriber(&topic, Start::New);
    for n in 0..4_u8 {
        publisher.publish(&[n; 10]).unwrap();
    }
    publisher.loan(100).unwrap().write_at(0, &[0xEE; 100]);
    let mut buffer = Vec::new();
    assert_eq!(next_message(&mut subscriber, &mut buffer), (1, 1));
    publisher.loan(100).unwrap().write_at(50, &[0xEE; 50]);
    assert_eq!(publisher.publish(b"instead"), Ok(4));
    for n in 2..5 {
        assert_eq!(next_message(&mut subscriber, &mut buffer), (n, 0));
    }
    assert_eq!(buffer, b"instead");
}

#[test]
fn a_loan_can_be_suspended_and_taken_up_again_until_something_else_is_published() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut reader = subscriber(&topic, Start::New);
    let mut loan = publisher.loan(5).unwrap();
    loan.write_at(0, b"later");
    let suspended = loan.suspend();
    assert_eq!((suspended.len(), suspended.is_empty()), (5, false));
    assert_eq!(suspended.resume(&mut publisher).unwrap().commit(), 0);
    let mut buffer = Vec::new();
    next_message(&mut reader, &mut buffer);
    assert_eq!(buffer, b"later");

    let stale = publisher.loan(5).unwrap().suspend();
    publisher.publish(b"meanwhile").unwrap();
    assert!(stale.resume(&mut publisher).is_none());

    let other_topic = Scratch::new();
    let mut other = self::publisher(&other_topic);
    other.publish(b"0").unwrap();
    other.publish(b"1").unwrap();
    let ours = publisher.loan(5).unwrap().suspend();
    assert!(ours.resume(&mut other).is_none());
}

#[test]
fn a_loan_is_never_longer_than_a_slot_nor_written_past_its_end() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let refused = publisher.loan(8173).unwrap_err();
    assert_eq!(
        refused,
        PublishError::TooLarge {
            len: 8173,
            max: 8172
        }
    );
    assert_eq!(publisher.info().rejected_oversize, 1);
    let mut loan = publisher.loan(5).unwrap();
    assert_eq!(loan.write(b"too long").unwrap(), 5);
    assert_eq!(loan.write(b"more").unwrap(), 0);
    let past_the_end = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        loan.write_at(4, b"xy");
    }));
    assert!(past_the_end.is_err());
}
