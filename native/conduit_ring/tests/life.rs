//! How topics are made, taken over, retired and closed, and how subscribers notice.
#![cfg(not(loom))]

mod support;

use std::os::unix::fs::{PermissionsExt, symlink};
use std::sync::atomic::Ordering::Relaxed;
use std::thread;

use conduit_ring::{
    ContentTag, Error, Fault, Geometry, Info, Listing, Policy, Publisher, PublisherOptions, Read,
    Received, Start, State, Subscriber, SubscriberOptions, Topic, Wait,
};
use support::{LONG, Raw, Scratch, next, next_message};

fn publisher(topic: &Topic) -> Publisher {
    Publisher::open(topic, &PublisherOptions::default()).unwrap()
}

fn subscriber(topic: &Topic) -> Subscriber {
    Subscriber::open(topic, &SubscriberOptions::default()).unwrap()
}

#[test]
fn a_closed_topic_is_read_to_its_end_and_followed_into_its_next_life() {
    let topic = Scratch::new();
    let mut first = publisher(&topic);
    let mut subscriber = subscriber(&topic);
    let mut buffer = Vec::new();
    first.publish(b"last words").unwrap();
    first.close();
    assert!(!topic.path().exists());
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherDown);
    assert_eq!(subscriber.try_read(&mut buffer).unwrap(), Read::Nothing);
    let mut second = publisher(&topic);
    second.publish(b"first words").unwrap();
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherUp);
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    assert_eq!(buffer, b"first words");
    assert_eq!(
        (subscriber.stats().delivered, subscriber.stats().lost),
        (2, 0)
    );
}

#[test]
fn closing_wakes_a_sleeping_subscriber_at_once() {
    let topic = Scratch::new();
    let publisher = publisher(&topic);
    let mut subscriber = subscriber(&topic);
    thread::scope(|scope| {
        let sleeper = scope.spawn(|| next(&mut subscriber, &mut Vec::new()));
        while !publisher.info().readers[0].waiting {
            thread::yield_now();
        }
        publisher.close();
        assert_eq!(sleeper.join().unwrap(), Read::PublisherDown);
    });
}

/// Leaves a segment whose publisher died: a copy of a living publisher's, since a copy has no
/// lock.
fn leave_dead(topic: &Topic, geometry: Geometry, messages: u64) {
    let original = Scratch::new();
    let mut publisher = Publisher::open(
        &original,
        &PublisherOptions {
            geometry,
            ..Default::default()
        },
    )
    .unwrap();
    (0..messages).for_each(|n| assert_eq!(publisher.publish(&n.to_le_bytes()), Ok(n)));
    std::fs::copy(original.path(), topic.path()).unwrap();
}

#[test]
fn a_dead_topic_of_the_same_geometry_continues_at_the_same_number() {
    let topic = Scratch::new();
    leave_dead(&topic, Geometry::default(), 5);
    let dead = Info::read(&topic).unwrap();
    assert_eq!(
        (dead.state, dead.published, dead.epoch),
        (State::Dead, 5, 0)
    );
    let history = SubscriberOptions {
        start: Start::History(2),
        ..Default::default()
    };
    let mut subscriber = Subscriber::open(&topic, &history).unwrap();
    assert!(!subscriber.publisher_up());
    let mut buffer = Vec::new();
    assert_eq!(next_message(&mut subscriber, &mut buffer), (3, 0));
    let mut publisher = publisher(&topic);
    let live = publisher.info();
    assert_eq!(
        (live.state, live.epoch, live.instance_id),
        (State::Live, 1, dead.instance_id)
    );
    assert_eq!(live.writer_pid, std::process::id());
    assert_eq!(publisher.publish(b"on"), Ok(5));
    assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherUp);
    assert_eq!(next_message(&mut subscriber, &mut buffer), (4, 0));
    assert_eq!(next_message(&mut subscriber, &mut buffer), (5, 0));
}

#[test]
fn a_dead_topic_of_another_geometry_or_content_is_retired_and_its_subscribers_follow() {
    let other_geometry = PublisherOptions {
        geometry: Geometry::slots(8, 64).unwrap(),
        ..Default::default()
    };
    let other_content = PublisherOptions {
        content: ContentTag::of("other"),
        ..Default::default()
    };
    for options in [other_geometry, other_content] {
        let topic = Scratch::new();
        leave_dead(&topic, Geometry::default(), 5);
        let old = Raw::open(&topic).unwrap();
        let dead = Info::read(&topic).unwrap();
        let mut subscriber = subscriber(&topic);
        let mut publisher = Publisher::open(&topic, &options).unwrap();
        assert_eq!(old.u32(28).load(Relaxed), 3);
        assert_ne!(publisher.info().instance_id, dead.instance_id);
        assert_eq!(publisher.publish(b"new"), Ok(0));
        let mut buffer = Vec::new();
        assert_eq!(next(&mut subscriber, &mut buffer), Read::PublisherUp);
        assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
        assert_eq!(subscriber.geometry(), Some(options.geometry));
        assert_eq!(subscriber.content(), Some(options.content));
    }
}

/// The sleeper has no time limit, as a legacy subscriber has none.
#[test]
fn a_takeover_wakes_sleepers() {
    let topic = Scratch::new();
    leave_dead(&topic, Geometry::default(), 1);
    let raw = Raw::open(&topic).unwrap();
    let seen = raw.u32(132).load(Relaxed);
    let (sender, receiver) = std::sync::mpsc::channel();
    let sleeper = thread::spawn(move || {
        raw.futex_wait(seen);
        sender.send(()).unwrap();
    });
    let _publisher = publisher(&topic);
    receiver.recv_timeout(LONG).expect("slept on");
    sleeper.join().unwrap();
}

#[test]
fn the_lock_of_a_publisher_that_was_dropped_is_free_although_its_memory_is_still_mapped() {
    let topic = Scratch::new();
    leave_dead(&topic, Geometry::default(), 1);
    let mut second = publisher(&topic);
    let mapped = second.loan(1).unwrap().suspend();
    second.abandon();
    assert_eq!(publisher(&topic).publish(b"third"), Ok(1));
    assert_eq!(mapped.sequence(), 1);
}

#[test]
fn permissions_are_those_asked_for_whatever_the_umask() {
    let topic = Scratch::new();
    let mode = |topic: &Topic| {
        std::fs::metadata(topic.path())
            .unwrap()
            .permissions()
            .mode()
            & 0o7777
    };
    let default = publisher(&topic);
    assert_eq!(mode(&topic), 0o660);
    drop(default);
    let _open = Publisher::open(
        &topic,
        &PublisherOptions {
            mode: 0o666,
            ..Default::default()
        },
    )
    .unwrap();
    assert_eq!(mode(&topic), 0o666);
}

#[test]
#[cfg_attr(
    target_pointer_width = "32",
    ignore = "on a 32-bit machine the largest geometry, 2 GiB, may fit into memory"
)]
fn a_full_file_system_is_an_error_with_its_errno_and_leaves_no_file() {
    let topic = Scratch::new();
    let geometry = Geometry::slots(1 << 20, 1 << 30).unwrap();
    let error = Publisher::open(
        &topic,
        &PublisherOptions {
            geometry,
            ..Default::default()
        },
    )
    .unwrap_err();
    assert_eq!(error.errno(), Some(libc::ENOSPC), "{error}");
    assert!(error.to_string().contains(topic.name()), "{error}");
    assert!(!topic.path().exists());
}

#[test]
fn a_name_that_leads_to_no_plain_file_is_refused() {
    let topic = Scratch::new();
    let target = Scratch::new();
    let _target = publisher(&target);
    symlink(target.path(), topic.path()).unwrap();
    let errors = || {
        [
            Publisher::open(&topic, &PublisherOptions::default()).unwrap_err(),
            Subscriber::open(&topic, &SubscriberOptions::default()).unwrap_err(),
            Info::read(&topic).unwrap_err(),
        ]
    };
    assert!(
        errors()
            .iter()
            .all(|error| error.errno() == Some(libc::ELOOP))
    );
    std::fs::remove_file(topic.path()).unwrap();
    std::fs::create_dir(topic.path()).unwrap();
    let [publisher, subscriber, info] = errors();
    assert_eq!(publisher.errno(), Some(libc::EISDIR));
    for error in [subscriber, info] {
        assert!(
            matches!(
                error,
                Error::BadSegment {
                    fault: Fault::NotAFile,
                    ..
                }
            ),
            "{error}"
        );
    }
    std::fs::remove_dir(topic.path()).unwrap();
    assert!(matches!(
        Info::read(&topic).unwrap_err(),
        Error::NoTopic { .. }
    ));
}

#[test]
fn starts_choose_the_first_message() {
    let topic = Scratch::new();
    let geometry = Geometry::slots(4, 64).unwrap();
    let mut publisher = Publisher::open(
        &topic,
        &PublisherOptions {
            geometry,
            ..Default::default()
        },
    )
    .unwrap();
    let first = |start| {
        let mut subscriber = Subscriber::open(
            &topic,
            &SubscriberOptions {
                start,
                ..Default::default()
            },
        )
        .unwrap();
        match subscriber.try_read(&mut Vec::new()).unwrap() {
            Read::Message(meta) => Some((meta.sequence, meta.lost)),
            _ => None,
        }
    };
    assert_eq!(
        [Start::New, Start::Latest, Start::History(3)].map(first),
        [None; 3]
    );
    for _ in 0..10 {
        publisher.publish(b"x").unwrap();
    }
    assert_eq!(first(Start::New), None);
    assert_eq!(first(Start::Latest), Some((9, 0)));
    assert_eq!(first(Start::History(0)), None);
    assert_eq!(first(Start::History(3)), Some((7, 0)));
    assert_eq!(first(Start::History(u32::MAX)), Some((6, 0)));
}

#[test]
fn a_message_can_be_read_into_a_buffer_made_for_it() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = subscriber(&topic);
    publisher.publish_slices(&[b"ab", b"", b"cde"]).unwrap();
    let Received::Message(meta, buffer) = subscriber
        .try_read_with(|len| vec![0; len].into_boxed_slice())
        .unwrap()
    else {
        panic!()
    };
    assert_eq!((meta.len, &*buffer), (5, &b"abcde"[..]));
    assert_eq!(
        subscriber.try_read_with(|len| vec![0; len]).unwrap(),
        Received::Nothing
    );
}

#[test]
fn latest_only_gives_the_newest_and_counts_the_skipped() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let options = SubscriberOptions {
        policy: Policy::Latest,
        ..Default::default()
    };
    let mut subscriber = Subscriber::open(&topic, &options).unwrap();
    let mut buffer = Vec::new();
    for (count, expected) in [(1, (0, 0)), (3, (3, 2)), (40, (43, 39))] {
        for _ in 0..count {
            publisher.publish(b"x").unwrap();
        }
        assert_eq!(next_message(&mut subscriber, &mut buffer), expected);
    }
    assert_eq!(subscriber.stats().lost, 41);
    assert_eq!(publisher.info().readers[0].lost, 41);
}

#[test]
fn without_a_sleeper_no_wake_up_call_is_made() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = subscriber(&topic);
    for _ in 0..100 {
        publisher.publish(b"x").unwrap();
        assert_eq!(subscriber.wait(LONG).unwrap(), Wait::Ready);
        assert!(matches!(
            subscriber.try_read(&mut Vec::new()).unwrap(),
            Read::Message(_)
        ));
    }
    assert_eq!(publisher.info().wake_count, 0);
}

#[test]
fn of_publishers_that_start_at_once_one_wins() {
    let topic = Scratch::new();
    for _ in 0..50 {
        let results: Vec<_> = thread::scope(|scope| {
            let starts: Vec<_> = (0..4)
                .map(|_| scope.spawn(|| Publisher::open(&topic, &PublisherOptions::default())))
                .collect();
            starts
                .into_iter()
                .map(|start| start.join().unwrap())
                .collect()
        });
        let losers = results.iter().filter_map(|result| result.as_ref().err());
        assert!(
            losers
                .clone()
                .all(|error| matches!(error, Error::PublisherAlive { .. }))
        );
        assert_eq!(losers.count(), 3);
    }
}

#[test]
fn a_subscriber_that_finds_all_slots_taken_after_a_retirement_reports_it_and_attaches_later() {
    let topic = Scratch::new();
    let first = publisher(&topic);
    let mut late = subscriber(&topic);
    first.close();
    assert_eq!(next(&mut late, &mut Vec::new()), Read::PublisherDown);
    let mut second = publisher(&topic);
    let mut others: Vec<_> = (0..16).map(|_| subscriber(&topic)).collect();
    assert!(matches!(late.wait(LONG), Err(Error::NoReaderSlot { .. })));
    others.pop();
    second.publish(b"x").unwrap();
    assert_eq!(next(&mut late, &mut Vec::new()), Read::PublisherUp);
    assert_eq!(next_message(&mut late, &mut Vec::new()), (0, 0));
}

#[test]
fn a_reader_killed_while_it_claims_or_releases_leaks_no_slot() {
    let topic = Scratch::new();
    let publisher = publisher(&topic);
    let raw = Raw::open(&topic).unwrap();
    // All reader slots: bit set, native bit not yet or no longer set, and the lock free.
    raw.u32(128).store(0xFFFF, Relaxed);
    (0..16).for_each(|i| raw.u64(192 + 64 * i + 32).store(7, Relaxed));
    let readers: Vec<_> = (0..16).map(|_| subscriber(&topic)).collect();
    assert!(
        publisher
            .info()
            .readers
            .iter()
            .all(|reader| reader.native && reader.alive)
    );
    drop(readers);
    assert_eq!(publisher.info().readers, []);
}

#[test]
fn an_abandoned_topic_stays_for_the_next_publisher() {
    let topic = Scratch::new();
    let mut first = publisher(&topic);
    let mut subscriber = subscriber(&topic);
    first.publish(b"x").unwrap();
    let instance = first.info().instance_id;
    first.abandon();
    assert_eq!(Info::read(&topic).unwrap().state, State::Dead);
    let mut second = publisher(&topic);
    assert_eq!(
        (second.publish(b"y"), second.info().instance_id),
        (Ok(1), instance)
    );
    let mut buffer = Vec::new();
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    assert_eq!(next_message(&mut subscriber, &mut buffer), (1, 0));
}

#[test]
fn a_policy_can_be_changed() {
    let topic = Scratch::new();
    let mut publisher = publisher(&topic);
    let mut subscriber = subscriber(&topic);
    for _ in 0..4 {
        publisher.publish(b"x").unwrap();
    }
    let mut buffer = Vec::new();
    assert_eq!(next_message(&mut subscriber, &mut buffer), (0, 0));
    subscriber.set_policy(Policy::Latest);
    assert_eq!(next_message(&mut subscriber, &mut buffer), (3, 2));
}

#[test]
fn a_message_is_too_large_by_the_size_as_given_also_after_a_takeover() {
    let topic = Scratch::new();
    let options = PublisherOptions {
        geometry: Geometry::slots(4, 4100).unwrap(),
        ..Default::default()
    };
    let mut subscriber = subscriber(&topic);
    for life in 0..3_u64 {
        let mut publisher = Publisher::open(&topic, &options).unwrap();
        assert_eq!(publisher.next_sequence(), life);
        assert!(publisher.publish(&[1; 4081]).is_err());
        assert!(publisher.loan(4081).is_err());
        publisher.publish(&[1; 4080]).unwrap();
        let info = Info::read(&topic).unwrap();
        assert_eq!(info.geometry, options.geometry);
        assert_eq!(info.geometry.slot_size(), 4160);
        assert_eq!(next_message(&mut subscriber, &mut Vec::new()), (life, 0));
        publisher.abandon();
    }

    // The slots are the same, so that a publisher with another size takes over, with that size.
    let whole = PublisherOptions {
        geometry: Geometry::slots(4, 4160).unwrap(),
        ..Default::default()
    };
    let mut publisher = Publisher::open(&topic, &whole).unwrap();
    assert_eq!(publisher.next_sequence(), 3);
    publisher.publish(&[1; 4140]).unwrap();
    assert_eq!(Info::read(&topic).unwrap().geometry, whole.geometry);
}

#[test]
fn topics_with_names_of_other_rules_are_read_and_listed_but_not_made() {
    for name in ["cam 1", "front:rgb", "größe"] {
        let made = Scratch::new();
        let mut publisher = publisher(&made);
        let found = Scratch::found(name);
        let error = Publisher::open(&found, &PublisherOptions::default()).unwrap_err();
        assert!(matches!(error, Error::InvalidTopic { .. }), "{error}");

        std::fs::rename(made.path(), found.path()).unwrap();
        let mut subscriber = subscriber(&found);
        publisher.publish(b"seen").unwrap();
        assert_eq!(next_message(&mut subscriber, &mut Vec::new()), (0, 0));
        assert_eq!(Info::read(&found).unwrap().published, 1);
        let listing = Listing::read().unwrap();
        assert!(listing.topics.contains(&*found));
    }
}
