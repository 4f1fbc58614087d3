//! Topics whose names are removed, replaced or taken under their living publishers.
#![cfg(not(loom))]

mod support;

use std::fs;
use std::os::unix::fs::{PermissionsExt, chown};
use std::thread;
use std::time::Instant;

use conduit_ring::{
    Error, Geometry, Info, Nameless, Observer, ObserverOptions, PublishError, Publisher,
    PublisherOptions, Read, Received, Start, State, Subscriber, SubscriberOptions, Topic,
    nameless_publishers,
};
use support::{Helper, LONG, Scratch, next, next_message, report_ready, role};

/// The program of a helper process; not a test.
#[test]
fn child() {
    let Some((_, topic)) = role() else { return };
    let _publisher = publisher(&topic);
    report_ready();
    thread::sleep(std::time::Duration::MAX);
}

fn publisher(topic: &Topic) -> Publisher {
    let options = PublisherOptions {
        geometry: Geometry::slots(4, 128).unwrap(),
        mode: 0o640,
        ..Default::default()
    };
    Publisher::open(topic, &options).unwrap()
}

fn subscriber(topic: &Topic, start: Start) -> Subscriber {
    let options = SubscriberOptions {
        start,
        ..Default::default()
    };
    Subscriber::open(topic, &options).unwrap()
}

#[test]
fn a_publisher_whose_name_was_removed_makes_its_topic_anew_at_the_same_number() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut reader = subscriber(&topic, Start::New);
    let mut observer = Observer::open(&topic, &ObserverOptions::default()).unwrap();
    let mut buffer = Vec::new();
    publisher.publish(b"before").unwrap();
    next_message(&mut reader, &mut buffer);
    let before = Info::read(&topic).unwrap();
    fs::remove_file(topic.path()).unwrap();
    let deadline = Instant::now() + LONG;
    while Info::read(&topic).is_err() {
        publisher.publish(b"meanwhile").unwrap();
        assert_eq!(next_message(&mut reader, &mut buffer).1, 0);
        assert!(Instant::now() < deadline, "never noticed");
    }
    assert_eq!(publisher.renewals(), 1);
    let after = Info::read(&topic).unwrap();
    assert_eq!((after.state, after.epoch), (State::Live, before.epoch + 1));
    assert_eq!(after.instance_id, before.instance_id);
    assert_eq!(after.published, publisher.next_sequence());
    let mode = fs::metadata(topic.path()).unwrap().permissions().mode();
    assert_eq!(mode & 0o7777, 0o640);

    let n = publisher.publish(b"after").unwrap();
    let (read, lost) = next_message(&mut reader, &mut buffer);
    assert_eq!((read, lost, &buffer[..]), (n, 0, &b"after"[..]));
    while next_observed(&mut observer, &mut buffer) < n {}
    assert_eq!(buffer, b"after");
    assert_eq!(reader.stats().delivered, n + 1);
    assert!(Publisher::open(&topic, &PublisherOptions::default()).is_err());
    assert_eq!(
        next_message(&mut subscriber(&topic, Start::History(3)), &mut buffer).0,
        n - 2
    );
}

fn next_observed(observer: &mut Observer, buffer: &mut Vec<u8>) -> u64 {
    loop {
        match observer.read_timeout(buffer, LONG).unwrap() {
            Read::Message(meta) => return meta.sequence,
            Read::Nothing => panic!("nothing for {LONG:?}"),
            _ => {}
        }
    }
}

#[test]
fn a_silent_publisher_that_is_looked_after_makes_its_topic_anew_and_its_readers_follow() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    for n in 0..6_u8 {
        publisher.publish(&[n]).unwrap();
    }
    let mut reader = subscriber(&topic, Start::Latest);
    let mut buffer = Vec::new();
    assert_eq!(next_message(&mut reader, &mut buffer), (5, 0));
    publisher.look_after().unwrap();
    assert_eq!(publisher.renewals(), 0);
    fs::remove_file(topic.path()).unwrap();
    thread::scope(|scope| {
        let sleeper = scope.spawn(|| {
            let mut changes = vec![next(&mut reader, &mut buffer)];
            changes.push(next(&mut reader, &mut buffer));
            changes
        });
        publisher.look_after().unwrap();
        assert_eq!(
            sleeper.join().unwrap(),
            [Read::PublisherDown, Read::PublisherUp]
        );
    });
    assert_eq!(publisher.renewals(), 1);
    let mut late = subscriber(&topic, Start::Latest);
    assert_eq!(next_message(&mut late, &mut buffer), (5, 0));
    assert_eq!(buffer, [5]);
    assert_eq!(publisher.publish(b"on"), Ok(6));
    assert_eq!(next_message(&mut reader, &mut buffer), (6, 0));
}

#[test]
fn a_name_that_leads_to_an_unused_file_is_taken_back() {
    let put: [fn(&Topic); 3] = [
        |topic| fs::write(topic.path(), b"rubbish").unwrap(),
        |topic| fs::write(topic.path(), b"").unwrap(),
        |topic| publisher(topic).abandon(),
    ];
    for put in put {
        let topic = Scratch::new();
        let mut publisher = publisher(&topic);
        publisher.publish(b"0").unwrap();
        fs::remove_file(topic.path()).unwrap();
        put(&topic);
        publisher.look_after().unwrap();
        assert_eq!((publisher.renewals(), publisher.publish(b"1")), (1, Ok(1)));
        let info = Info::read(&topic).unwrap();
        assert_eq!(
            (info.state, info.published, info.instance_id),
            (State::Live, 2, publisher.info().instance_id)
        );
    }
}

#[test]
fn a_name_that_was_away_for_a_moment_is_no_reason_to_move() {
    let topic = Scratch::new();
    let aside = Scratch::new();
    let mut publisher = publisher(&topic);
    fs::rename(topic.path(), aside.path()).unwrap();
    fs::rename(aside.path(), topic.path()).unwrap();
    publisher.look_after().unwrap();
    assert_eq!((publisher.renewals(), publisher.info().epoch), (0, 0));
}

#[test]
fn a_publisher_whose_name_another_publisher_has_reports_it_publishes_nothing_and_waits() {
    let topic = Scratch::new();
    let mut first = publisher(&topic);
    first.publish(b"0").unwrap();
    fs::remove_file(topic.path()).unwrap();
    let second = Helper::start("second publisher", &topic);
    assert_eq!(first.look_after(), Err(PublishError::NameLost));
    for _ in 0..3 {
        assert_eq!(first.publish(b"1"), Err(PublishError::NameLost));
        assert!(matches!(first.loan(1), Err(PublishError::NameLost)));
    }
    let trouble = first.trouble().unwrap();
    assert!(
        matches!(trouble, Error::PublisherAlive { pid, .. } if *pid == second.pid()),
        "{trouble}"
    );
    assert_eq!(first.next_sequence(), 1);
    second.kill();
    assert_eq!(first.look_after(), Ok(()));
    assert!(first.trouble().is_none());
    assert_eq!(first.publish(b"1"), Ok(1));
    assert_eq!(Info::read(&topic).unwrap().published, 2);
}

#[test]
fn a_publisher_whose_name_a_stranger_has_reports_it_and_leaves_the_file_alone() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    fs::remove_file(topic.path()).unwrap();
    fs::write(topic.path(), b"squatted").unwrap();
    if chown(topic.path(), Some(65_534), None).is_err() {
        eprintln!("only root can give a file away: not tested");
        return;
    }
    assert_eq!(publisher.look_after(), Err(PublishError::NameLost));
    let trouble = publisher.trouble().unwrap();
    assert!(
        matches!(trouble, Error::ForeignOwner { user: 65_534, .. }),
        "{trouble}"
    );
    assert_eq!(fs::read(topic.path()).unwrap(), b"squatted");
    fs::remove_file(topic.path()).unwrap();
    let deadline = Instant::now() + LONG;
    while publisher.publish(b"on").is_err() {
        assert!(Instant::now() < deadline, "never tried again");
    }
}

#[test]
fn leases_and_loans_stay_as_they_are_when_the_name_is_lost() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut reader = subscriber(&topic, Start::New);
    let mut hold = |publisher: &mut Publisher| {
        publisher.publish(b"held").unwrap();
        loop {
            if let Received::Message(_, lease) = reader.try_lease().unwrap() {
                return lease;
            }
        }
    };
    drop(hold(&mut publisher));
    let lease = hold(&mut publisher);
    let lent = publisher.loan(4).unwrap().suspend();
    fs::remove_file(topic.path()).unwrap();
    publisher.look_after().unwrap();
    assert!(lent.resume(&mut publisher).is_none());
    for n in 2..20 {
        assert_eq!(
            publisher.publish(b"over it"),
            Ok(n),
            "nothing is held there"
        );
    }
    assert_eq!(lease.to_vec(), b"held");
    drop(lease);
    // The first lease on a segment may be a copy.
    drop(hold(&mut publisher));
    assert!(hold(&mut publisher).holds_slot());
}

#[test]
fn a_publisher_without_a_name_is_found_by_its_mapping() {
    let topic = Scratch::new();
    let helper = Helper::start("idle publisher", &topic);
    let _reader = subscriber(&topic, Start::New);
    let found = || -> Vec<Nameless> {
        let mut found = nameless_publishers();
        found.retain(|found| found.topic.name() == topic.name());
        found
    };
    assert_eq!(found(), []);
    fs::remove_file(topic.path()).unwrap();
    assert!(
        found().iter().any(|found| found.pid == helper.pid()),
        "{:?}",
        found()
    );
    helper.kill();
    assert_eq!(found(), [], "a reader alone is not listed");
}
