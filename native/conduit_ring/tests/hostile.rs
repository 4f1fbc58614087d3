//! Files that are damaged or made in bad faith give an error or no data: never a crash, a hang or
//! a byte out of bounds.
#![cfg(not(loom))]

mod support;

use std::time::Duration;

use conduit_ring::{
    Error, Geometry, Guard, Info, Policy, Publisher, PublisherOptions, Read, Received, Start,
    Subscriber, SubscriberOptions,
};
use proptest::prelude::*;
use support::{Raw, Scratch};

const HEADER: usize = 1216;

/// The bytes of a sound segment with some messages in it.
fn sound(geometry: Geometry, messages: u8) -> Vec<u8> {
    let topic = Scratch::new();
    let mut publisher = Publisher::open(
        &topic,
        &PublisherOptions {
            geometry,
            ..Default::default()
        },
    )
    .unwrap();
    (0..messages).for_each(|n| assert!(publisher.publish(&[n; 30]).is_ok()));
    std::fs::read(topic.path()).unwrap()
}

fn small() -> Geometry {
    Geometry::slots(4, 64).unwrap()
}

fn is_documented(error: &Error) -> bool {
    matches!(
        error,
        Error::BadSegment { .. }
            | Error::NoReaderSlot { .. }
            | Error::NoTopic { .. }
            | Error::Os { .. }
    )
}

/// Uses a file in every way that a peer does.
fn use_file(bytes: &[u8]) {
    let topic = Scratch::new();
    std::fs::write(topic.path(), bytes).unwrap();
    if let Err(error) = Info::read(&topic) {
        assert!(is_documented(&error), "{error}");
    }
    for (start, policy) in [
        (Start::New, Policy::All),
        (Start::History(u32::MAX), Policy::All),
        (Start::Latest, Policy::Latest),
    ] {
        for guard in [Guard::Never, Guard::Always] {
            let options = SubscriberOptions {
                start,
                policy,
                guard,
            };
            match Subscriber::open(&topic, &options) {
                Ok(subscriber) => read_a_while(subscriber, bytes.len()),
                Err(error) => assert!(is_documented(&error), "{error}"),
            }
        }
    }
    let options = PublisherOptions {
        geometry: small(),
        ..Default::default()
    };
    let mut publisher = Publisher::open(&topic, &options).unwrap();
    assert!(publisher.publish(b"from now on all is well").is_ok());
}

fn read_a_while(mut subscriber: Subscriber, file_len: usize) {
    let mut buffer = Vec::new();
    for _ in 0..20 {
        match subscriber.try_read(&mut buffer) {
            Ok(Read::Message(meta)) => assert!(meta.len == buffer.len() && meta.len <= file_len),
            Ok(_) => {}
            Err(error) => assert!(is_documented(&error), "{error}"),
        }
        match subscriber.try_lease() {
            Ok(Received::Message(meta, lease)) => {
                assert!(lease.to_vec().len() == meta.len && meta.len <= file_len);
            }
            Ok(_) => {}
            Err(error) => assert!(is_documented(&error), "{error}"),
        }
        let _ = subscriber.wait(Duration::ZERO);
    }
}

/// Stores the CRC-32 (IEEE 802.3) of geometry and content tag.
fn seal(bytes: &mut [u8]) {
    let mut crc = !0_u32;
    for byte in bytes[..16].iter().chain(&bytes[48..56]) {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 };
        }
    }
    bytes[60..64].copy_from_slice(&(!crc).to_le_bytes());
}

fn interesting() -> impl Strategy<Value = u64> {
    prop_oneof![
        any::<u64>(),
        0..40_u64,
        (0..40_u64).prop_map(|n| u64::MAX - n),
        (0..64_u32).prop_map(|bit| 1 << bit),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 400, failure_persistence: None, ..Default::default()
    })]

    #[test]
    fn random_bytes_are_an_error(bytes in prop::collection::vec(any::<u8>(), 0..3000)) {
        use_file(&bytes);
    }

    #[test]
    fn random_damage_to_a_sound_file_is_survived(
        messages in 0..10_u8,
        damage in prop::collection::vec((0..HEADER + 256, any::<u8>()), 1..40),
    ) {
        let mut bytes = sound(small(), messages);
        for (at, value) in damage {
            bytes[at] = value;
        }
        use_file(&bytes);
    }

    #[test]
    fn every_geometry_with_a_right_checksum_is_checked_against_the_file(
        slot_count in interesting(),
        slot_size in interesting(),
        readers in prop_oneof![9 => Just(16), 1 => any::<u32>()],
        len in 0..4000_usize,
    ) {
        let mut bytes = sound(small(), 3);
        bytes[..4].copy_from_slice(&(slot_count as u32).to_le_bytes());
        bytes[4..8].copy_from_slice(&(slot_size as u32).to_le_bytes());
        bytes[8..12].copy_from_slice(&readers.to_le_bytes());
        seal(&mut bytes);
        bytes.resize(len, 0x5A);
        use_file(&bytes);
    }

    #[test]
    fn any_counters_masks_and_lengths_are_survived(
        write_idx in interesting(), intent in interesting(), masks in any::<[u32; 5]>(),
        slots in prop::collection::vec((interesting(), interesting()), 4),
        legacy in any::<bool>(),
    ) {
        let mut bytes = sound(small(), 3);
        bytes[64..72].copy_from_slice(&write_idx.to_le_bytes());
        bytes[72..80].copy_from_slice(&intent.to_le_bytes());
        for (i, mask) in masks.iter().enumerate() {
            bytes[128 + 4 * i..132 + 4 * i].copy_from_slice(&mask.to_le_bytes());
        }
        for (i, (len, sequence)) in slots.iter().enumerate() {
            let slot = HEADER + 64 * i;
            bytes[slot..slot + 4].copy_from_slice(&(*len as u32).to_le_bytes());
            bytes[slot + 4..slot + 12].copy_from_slice(&sequence.to_le_bytes());
        }
        if legacy {
            bytes[16..64].fill(0);
        }
        use_file(&bytes);
    }

    #[test]
    fn a_header_that_changes_under_a_subscriber_is_survived(
        changes in prop::collection::vec((0..HEADER / 8, interesting()), 1..60),
        guarded in any::<bool>(),
    ) {
        let topic = Scratch::new();
        std::fs::write(topic.path(), sound(small(), 6)).unwrap();
        let raw = Raw::open(&topic).unwrap();
        let guard = if guarded { Guard::Always } else { Guard::Never };
        let options = SubscriberOptions { start: Start::History(4), guard, ..Default::default() };
        let mut subscriber = Subscriber::open(&topic, &options).unwrap();
        let mut buffer = Vec::new();
        for (word, value) in changes {
            raw.u64(8 * word).store(value, std::sync::atomic::Ordering::Relaxed);
            match subscriber.try_read(&mut buffer) {
                Ok(Read::Message(meta)) => {
                    prop_assert!(meta.len == buffer.len() && meta.len <= 44)
                }
                Ok(_) => {}
                Err(error) => prop_assert!(is_documented(&error), "{}", error),
            }
            let _ = subscriber.wait(Duration::ZERO);
        }
    }
}
