//! One publisher and its subscribers in one process.
#![cfg(not(loom))]

#[path = "support/run.rs"]
mod run;

use std::thread;
use std::time::Duration;

use conduit_ring::{
    ContentTag, Error, Geometry, Info, Policy, PublishError, Publisher, PublisherOptions, Read,
    Start, State, Subscriber, SubscriberOptions, Topic, Wait,
};

fn topic() -> Topic {
    Topic::new(&run::unique("happy")).unwrap()
}

fn open(topic: &Topic) -> Publisher {
    Publisher::open(topic, &PublisherOptions::default()).unwrap()
}

const LONG: Duration = Duration::from_secs(60);

#[test]
fn messages_arrive_in_order_with_their_numbers() {
    let topic = topic();
    let mut publisher = open(&topic);
    let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let mut buffer = Vec::new();
    for n in 0..100_u64 {
        assert_eq!(
            publisher.publish_slices(&[b"no ", n.to_string().as_bytes()]),
            Ok(n)
        );
        let Read::Message(meta) = subscriber.try_read(&mut buffer).unwrap() else {
            panic!()
        };
        assert_eq!((meta.sequence, meta.lost), (n, 0));
        assert_eq!(buffer, format!("no {n}").into_bytes());
    }
    assert_eq!(subscriber.try_read(&mut buffer).unwrap(), Read::Nothing);
    drop(publisher);
    assert_eq!(
        subscriber.read_timeout(&mut buffer, LONG).unwrap(),
        Read::PublisherDown
    );
    let _again = open(&topic);
    assert_eq!(
        subscriber.read_timeout(&mut buffer, LONG).unwrap(),
        Read::PublisherUp
    );
}

#[test]
fn a_topic_that_does_not_exist_yet_is_awaited() {
    let topic = topic();
    let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let mut buffer = Vec::new();
    assert_eq!(subscriber.wait(Duration::ZERO).unwrap(), Wait::TimedOut);
    let waiter = thread::spawn(move || {
        let first = subscriber.read_timeout(&mut buffer, LONG).unwrap();
        let second = subscriber.read_timeout(&mut buffer, LONG).unwrap();
        (first, second, buffer)
    });
    let mut publisher = open(&topic);
    publisher.publish(b"first").unwrap();
    let (first, second, buffer) = waiter.join().unwrap();
    assert_eq!(first, Read::PublisherUp);
    assert!(matches!(second, Read::Message(meta) if meta.sequence == 0 && meta.lost == 0));
    assert_eq!(buffer, b"first");
}

#[test]
fn a_waker_ends_both_kinds_of_sleep() {
    let topic = topic();
    let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let waker = subscriber.waker();
    for _ in 0..2 {
        thread::scope(|scope| {
            let sleeper = scope.spawn(|| subscriber.wait(LONG).unwrap());
            waker.wake();
            assert_eq!(sleeper.join().unwrap(), Wait::Woken);
        });
        let _publisher = open(&topic);
        assert_eq!(
            subscriber.read_timeout(&mut Vec::new(), LONG).unwrap(),
            Read::PublisherUp
        );
        thread::scope(|scope| {
            let sleeper = scope.spawn(|| subscriber.wait(LONG).unwrap());
            waker.wake();
            assert_eq!(sleeper.join().unwrap(), Wait::Woken);
        });
        drop(_publisher);
        assert_eq!(
            subscriber.read_timeout(&mut Vec::new(), LONG).unwrap(),
            Read::PublisherDown
        );
    }
}

#[test]
fn a_second_publisher_is_refused_with_the_first_ones_pid() {
    let topic = topic();
    let _publisher = open(&topic);
    let error = Publisher::open(&topic, &PublisherOptions::default()).unwrap_err();
    assert!(
        matches!(error, Error::PublisherAlive { pid, .. } if pid == std::process::id()),
        "{error}"
    );
}

#[test]
fn a_seventeenth_subscriber_is_refused_until_a_slot_is_free() {
    let topic = topic();
    let _publisher = open(&topic);
    let options = SubscriberOptions::default();
    let mut sixteen: Vec<_> = (0..16)
        .map(|_| Subscriber::open(&topic, &options).unwrap())
        .collect();
    let error = Subscriber::open(&topic, &options).unwrap_err();
    assert!(matches!(error, Error::NoReaderSlot { .. }), "{error}");
    sixteen.pop();
    Subscriber::open(&topic, &options).unwrap();
}

#[test]
fn a_message_that_does_not_fit_is_an_error_and_counted() {
    let topic = topic();
    let mut publisher = open(&topic);
    assert_eq!(
        publisher.publish(&[0; 4077]),
        Err(PublishError::TooLarge {
            len: 4077,
            max: 4076
        })
    );
    assert_eq!(publisher.publish(&[0; 4076]), Ok(0));
    let info = Info::read(&topic).unwrap();
    assert_eq!(
        (info.published, info.rejected_oversize, info.state),
        (1, 1, State::Live)
    );
}

#[test]
fn lost_messages_are_counted_for_the_message_after_them() {
    let topic = topic();
    let geometry = Geometry::slots(4, 64).unwrap();
    let options = PublisherOptions {
        geometry,
        content: ContentTag::of("x"),
        ..Default::default()
    };
    let mut publisher = Publisher::open(&topic, &options).unwrap();
    let mut all = Subscriber::open(&topic, &SubscriberOptions::default()).unwrap();
    let latest = SubscriberOptions {
        policy: Policy::Latest,
        ..Default::default()
    };
    let mut latest = Subscriber::open(&topic, &latest).unwrap();
    for n in 0..10_u8 {
        publisher.publish(&[n]).unwrap();
    }
    let mut buffer = Vec::new();
    for (sequence, lost) in [(6, 6), (7, 0), (8, 0), (9, 0)] {
        let Read::Message(meta) = all.try_read(&mut buffer).unwrap() else {
            panic!()
        };
        assert_eq!(
            (meta.sequence, meta.lost, &*buffer),
            (sequence, lost, &[sequence as u8][..])
        );
    }
    let Read::Message(meta) = latest.try_read(&mut buffer).unwrap() else {
        panic!()
    };
    assert_eq!((meta.sequence, meta.lost), (9, 9));
    let history = SubscriberOptions {
        start: Start::History(2),
        ..Default::default()
    };
    let mut history = Subscriber::open(&topic, &history).unwrap();
    let Read::Message(meta) = history.try_read(&mut buffer).unwrap() else {
        panic!()
    };
    assert_eq!((meta.sequence, meta.lost), (8, 0));
    assert_eq!(history.content(), Some(ContentTag::of("x")));
}

#[test]
fn publishers_subscribers_and_wakers_can_move_to_other_threads() {
    fn moves<T: Send>() {}
    fn is_shared<T: Send + Sync>() {}
    moves::<Publisher>();
    moves::<Subscriber>();
    is_shared::<conduit_ring::Waker>();
    is_shared::<Error>();
}
