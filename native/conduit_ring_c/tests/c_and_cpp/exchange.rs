//! Checksummed messages between Rust, C and C++, in every direction, and across the death of a
//! publisher.

use conduit_ring::{Geometry, Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions};

use crate::toolchain::{C_PEER, CPP_PEER, LIMIT, Process, TestTopic};

/// No more than the ring holds, so that no subscriber falls behind.
const COUNT: u64 = 1000;

/// Returns message `n` as `programs/checked.h` describes it.
fn message(n: u64) -> Vec<u8> {
    let len = (n as u32).wrapping_mul(2_654_435_761) as usize % 3000;
    let bytes: Vec<u8> = (16..16 + len as u64)
        .map(|i| n.wrapping_mul(31).wrapping_add(i * 7) as u8)
        .collect();
    let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    [&n.to_le_bytes()[..], &hash.to_le_bytes(), &bytes].concat()
}

fn expect_all(subscriber: &mut Subscriber) {
    let mut buffer = Vec::new();
    for n in 0..COUNT {
        let read = subscriber.read_timeout(&mut buffer, LIMIT).unwrap();
        assert!(
            matches!(read, Read::Message(meta) if meta.sequence == n && meta.lost == 0),
            "{n}: {read:?}"
        );
        assert!(buffer == message(n), "message {n} is torn");
    }
}

/// Asserts that subscribers of all three languages get the messages that `go` publishes.
fn from(topic: &TestTopic, go: impl FnOnce()) {
    let mut rust = Subscriber::open(&topic.0, &SubscriberOptions::default()).unwrap();
    let arguments = ["subscribe", topic.name(), &COUNT.to_string()];
    let mut others: Vec<Process> = [&C_PEER, &CPP_PEER]
        .into_iter()
        .filter_map(|peer| peer.start(arguments))
        .collect();
    others.iter_mut().for_each(|peer| peer.expect("ready"));
    go();
    expect_all(&mut rust);
    for mut peer in others {
        peer.expect("whole");
        assert!(peer.end().success());
    }
}

fn from_process(peer: Option<Process>, topic: &TestTopic) {
    let Some(mut publisher) = peer else { return };
    publisher.expect("open");
    from(topic, || publisher.go());
    assert!(publisher.end().success());
    assert!(!topic.0.path().exists(), "closed at its end");
}

#[test]
fn rust_c_and_cpp_read_what_rust_publishes() {
    let topic = TestTopic::new();
    let options = PublisherOptions {
        geometry: Geometry::depth(1024, 3016).unwrap(),
        ..PublisherOptions::default()
    };
    let mut publisher = Publisher::open(&topic.0, &options).unwrap();
    from(&topic, || {
        for n in 0..COUNT {
            assert_eq!(publisher.publish(&message(n)), Ok(n));
        }
    });
}

#[test]
fn rust_c_and_cpp_read_what_c_publishes() {
    let topic = TestTopic::new();
    let arguments = ["publish", topic.name(), &COUNT.to_string()];
    from_process(C_PEER.start(arguments), &topic);
}

#[test]
fn rust_c_and_cpp_read_what_cpp_publishes() {
    let topic = TestTopic::new();
    let arguments = ["publish", topic.name(), &COUNT.to_string()];
    from_process(CPP_PEER.start(arguments), &topic);
}

#[test]
fn a_waiting_cpp_subscriber_survives_the_killing_and_restarting_of_its_publisher() {
    let topic = TestTopic::new();
    let Some(mut follower) = CPP_PEER.start(["follow", topic.name(), "2000"]) else {
        return;
    };
    let flood = || CPP_PEER.start(["flood", topic.name(), "0"]).unwrap();
    let mut publisher = flood();
    follower.expect("ready");
    follower.expect("following");
    for _ in 0..5 {
        publisher.signal(libc::SIGKILL);
        publisher.end();
        publisher = flood();
    }
    follower.expect("whole");
    assert!(follower.end().success());
}

#[test]
fn a_killed_cpp_subscriber_leaves_its_slot_to_the_next() {
    let topic = TestTopic::new();
    let mut publisher = Publisher::open(&topic.0, &PublisherOptions::default()).unwrap();
    for n in 0..20 {
        let Some(mut victim) = CPP_PEER.start(["follow", topic.name(), "1000000"]) else {
            return;
        };
        victim.expect("ready");
        publisher.publish(&message(n)).unwrap();
        victim.expect("following");
        victim.signal(libc::SIGKILL);
        victim.end();
    }
    let mut last = Subscriber::open(&topic.0, &SubscriberOptions::default()).unwrap();
    publisher.publish(b"for the last").unwrap();
    let mut buffer = Vec::new();
    last.read_timeout(&mut buffer, LIMIT).unwrap();
    assert_eq!(buffer, b"for the last");
}
