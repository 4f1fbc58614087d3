//! The Rust peer of the package's tests.
//!
//! ```text
//! usage: peer publish TOPIC COUNT    prints "open", waits for a line, publishes messages
//!                                    0..COUNT, waits for the end of input
//!        peer subscribe TOPIC COUNT  prints "ready", reads messages 0..COUNT, prints "whole"
//!        peer flood TOPIC            prints "open", publishes until it is killed; message n has
//!                                    sequence number n
//!        peer burst TOPIC COUNT      prints "open", publishes COUNT messages for each line of
//!                                    input and prints "published"
//! ```
//!
//! Message n has 16 + (n · 2654435761 mod 2^32) mod 3000 bytes: its number, the FNV-1a hash of
//! all later bytes, and bytes that depend on the number. `tests/checked.py` has the same in
//! Python.

use std::io::{self, Write};
use std::thread;
use std::time::Duration;

use conduit_ring::{
    Geometry, Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions, Topic,
};

const LONGEST: u32 = 3016;
const DEPTH: u32 = 1024;
const LIMIT: Duration = Duration::from_secs(30);

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["publish", topic, count] => publish(&named(topic), number(count)),
        ["subscribe", topic, count] => subscribe(&named(topic), number(count)),
        ["flood", topic] => flood(&named(topic)),
        ["burst", topic, count] => burst(&named(topic), number(count)),
        _ => panic!("unknown arguments; see the source for usage"),
    }
}

fn named(topic: &str) -> Topic {
    Topic::new(topic).unwrap()
}

fn number(text: &str) -> u64 {
    text.parse().unwrap()
}

fn message(n: u64) -> Vec<u8> {
    let len = u64::from((n as u32).wrapping_mul(2_654_435_761) % 3000);
    let body: Vec<u8> = (16..16 + len)
        .map(|i| n.wrapping_mul(31).wrapping_add(i * 7) as u8)
        .collect();
    let hash = body.iter().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    [&n.to_le_bytes()[..], &hash.to_le_bytes(), &body].concat()
}

fn open(topic: &Topic) -> Publisher {
    let options = PublisherOptions {
        geometry: Geometry::depth(DEPTH, LONGEST).unwrap(),
        ..PublisherOptions::default()
    };
    let publisher = Publisher::open(topic, &options).unwrap();
    say("open");
    publisher
}

fn publish_some(publisher: &mut Publisher, count: u64) {
    for _ in 0..count {
        let n = publisher.next_sequence();
        assert_eq!(publisher.publish(&message(n)), Ok(n));
    }
}

fn publish(topic: &Topic, count: u64) {
    let mut publisher = open(topic);
    line();
    publish_some(&mut publisher, count);
    while line() {}
}

fn burst(topic: &Topic, count: u64) {
    let mut publisher = open(topic);
    while line() {
        publish_some(&mut publisher, count);
        say("published");
    }
}

fn flood(topic: &Topic) {
    let mut publisher = open(topic);
    loop {
        publish_some(&mut publisher, 10);
        thread::sleep(Duration::from_millis(1));
    }
}

fn subscribe(topic: &Topic, count: u64) {
    let mut subscriber = Subscriber::open(topic, &SubscriberOptions::default()).unwrap();
    say("ready");
    let mut buffer = Vec::new();
    let mut expected = 0;
    while expected < count {
        match subscriber.read_timeout(&mut buffer, LIMIT).unwrap() {
            Read::Message(meta) => {
                assert_eq!((meta.sequence, meta.lost), (expected, 0));
                assert_eq!(buffer, message(expected), "message {expected} is torn");
                expected += 1;
            }
            Read::PublisherUp => {}
            other => panic!("{other:?} before message {expected}"),
        }
    }
    say("whole");
}

fn say(line: &str) {
    println!("{line}");
    io::stdout().flush().unwrap();
}

/// Waits for a line of input. Returns `false` at the end.
fn line() -> bool {
    io::stdin().read_line(&mut String::new()).unwrap() > 0
}
