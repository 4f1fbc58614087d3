//! docs/wire-format.md agrees with the code: its tables with `layout.rs`, its dumps with
//! segments.
#![cfg(not(loom))]

use std::collections::BTreeMap;
use std::fs;
use std::time::Duration;

use conduit_ring::{
    ContentTag, Geometry, Info, Publisher, PublisherOptions, Read, Start, State, Subscriber,
    SubscriberOptions,
};

mod support;
use support::Scratch;

#[allow(dead_code)]
#[path = "../src/layout.rs"]
mod layout;

const PAGE: &str = include_str!("../../../docs/wire-format.md");
const LAYOUT: &str = include_str!("../src/layout.rs");

/// Returns the bytes of the dump with this name.
fn vector(name: &str) -> Vec<u8> {
    let (_, rest) = PAGE.split_once(&format!("\n```hex {name}\n")).unwrap();
    let (dump, _) = rest.split_once("\n```").unwrap();
    dump.lines()
        .flat_map(|line| line.split('#').next().unwrap_or("").split_whitespace())
        .flat_map(|word| {
            let (byte, times) = word.split_once('*').unwrap_or((word, "1"));
            let byte = u8::from_str_radix(byte, 16).unwrap();
            std::iter::repeat_n(byte, times.parse().unwrap())
        })
        .collect()
}

/// Returns the cells of the table under this heading.
fn rows(heading: &str) -> Vec<Vec<&'static str>> {
    let (_, table) = PAGE.split_once(heading).unwrap();
    table
        .lines()
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
        .collect()
}

fn named(cell: &str) -> Option<String> {
    let name = cell.strip_prefix('`')?.strip_suffix('`')?;
    Some(name.to_uppercase())
}

/// Returns `(name, type, offset)` of each row that has a name.
fn fields(heading: &str) -> Vec<(String, String, usize)> {
    rows(heading)
        .iter()
        .filter_map(|row| Some((named(row[2])?, row[1].to_owned(), row[0].parse().unwrap())))
        .collect()
}

/// Returns the constants of this type in the source: name and value, as written.
fn constants(of: &str) -> BTreeMap<&'static str, &'static str> {
    LAYOUT
        .lines()
        .filter_map(|line| line.strip_prefix("pub(crate) const "))
        .filter_map(|line| line.split_once(&format!(": {of} = ")))
        .map(|(name, value)| (name, value.trim_end_matches(';')))
        .collect()
}

fn offset(value: &str) -> usize {
    let (_, digits) = value.split_once("::new(").unwrap();
    digits.trim_end_matches(')').parse().unwrap()
}

#[test]
fn the_page_has_all_fields_of_the_header_where_they_are() {
    let mut words = constants("At32");
    words.extend(constants("At64"));
    let mut source: Vec<_> = words
        .iter()
        .map(|(name, value)| (offset(value), name.to_string(), value.starts_with("At64")))
        .collect();
    source.sort();
    let page: Vec<_> = fields("| offset | type | field | |")
        .into_iter()
        .map(|(name, of, at)| (at, name, of.ends_with("64")))
        .collect();
    assert_eq!(page, source);
}

#[test]
fn the_page_has_the_fields_of_a_reader_slot_where_they_are() {
    let reader_slot = layout::ReaderSlot::all().nth(3).unwrap();
    let base = 192 + 64 * 3;
    assert_eq!(reader_slot.lock(), base as u64);
    let expected = [
        ("READ_IDX", "u64", reader_slot.read_idx().offset()),
        ("PID", "u32", reader_slot.pid().offset()),
        ("START_TIME", "u64", reader_slot.start_time().offset()),
        ("LOST_COUNT", "u64", reader_slot.lost_count().offset()),
        ("CLAIM_ID", "u64", reader_slot.claim_id().offset()),
        ("PINS", "u64 ×3", reader_slot.pins()[0].offset()),
    ]
    .map(|(name, of, at)| (name.to_owned(), of.to_owned(), at - base));
    assert_eq!(
        fields("| offset in the reader slot | type | field | |"),
        expected
    );
    assert_eq!(reader_slot.pins().len(), 3);
}

#[test]
fn the_page_has_the_fields_of_a_slot_and_all_values_as_they_are() {
    let mut page: BTreeMap<String, u64> = BTreeMap::new();
    for (name, of, at) in fields("| offset in the slot | type | field | |") {
        assert_eq!(of, "u32");
        page.insert(name, at as u64);
    }
    for row in rows("| value | |") {
        let number = row[1].split(',').next().unwrap();
        let number = number.strip_prefix("0x").map_or_else(
            || number.parse().unwrap(),
            |digits| u64::from_str_radix(digits, 16).unwrap(),
        );
        page.insert(named(row[0]).unwrap(), number);
    }
    let values: [(&str, u64); 16] = [
        ("SLOT_LEN", layout::SLOT_LEN as u64),
        ("SLOT_SEQ_LO", layout::SLOT_SEQ_LO as u64),
        ("SLOT_SEQ_HI", layout::SLOT_SEQ_HI as u64),
        ("SLOT_TIME_LO", layout::SLOT_TIME_LO as u64),
        ("SLOT_TIME_HI", layout::SLOT_TIME_HI as u64),
        ("HEADER_LEN", layout::HEADER_LEN as u64),
        ("SLOT_HEADER_LEN", layout::SLOT_HEADER_LEN as u64),
        ("READERS", layout::READERS.into()),
        ("EXT_MAGIC", layout::EXT_MAGIC.into()),
        ("VERSION_MAJOR", layout::VERSION_MAJOR.into()),
        ("VERSION_MINOR", layout::VERSION_MINOR.into()),
        ("REQUIRED_FEATURES", layout::REQUIRED_FEATURES.into()),
        ("STATE_LIVE", layout::STATE_LIVE.into()),
        ("STATE_CLOSED", layout::STATE_CLOSED.into()),
        ("STATE_RETIRED", layout::STATE_RETIRED.into()),
        ("POISON", layout::POISON.into()),
    ];
    let source: BTreeMap<String, u64> = values
        .into_iter()
        .map(|(name, value)| (name.to_owned(), value))
        .collect();
    assert_eq!(page, source);
    for of in ["u16", "u32", "usize"] {
        for name in constants(of).keys() {
            assert!(page.contains_key(*name), "the page has no {name}");
        }
    }
}

/// Clears the fields that vary between two files of the same content.
fn without_what_varies(mut segment: Vec<u8>) -> Vec<u8> {
    let varies = [
        32..40,
        40..48,
        80..84,
        88..96,
        96..104,
        1228..1236,
        1292..1300,
    ];
    for range in varies {
        segment[range].fill(0xEE);
    }
    segment
}

fn geometry() -> Geometry {
    Geometry::slots(2, 64).unwrap()
}

#[test]
fn a_publisher_makes_the_segment_that_the_page_shows() {
    let topic = Scratch::new();
    let options = PublisherOptions {
        geometry: geometry(),
        content: ContentTag::of("text/plain"),
        ..PublisherOptions::default()
    };
    let mut publisher = Publisher::open(&topic, &options).unwrap();
    let now = || without_what_varies(fs::read(topic.path()).unwrap());
    assert_eq!(now(), without_what_varies(vector("empty_segment")));
    for n in 0..3 {
        publisher.publish(format!("message{n}").as_bytes()).unwrap();
    }
    assert_eq!(now(), without_what_varies(vector("segment")));
}

#[test]
fn a_subscriber_reads_the_segment_that_the_page_shows() {
    let topic = Scratch::new();
    fs::write(topic.path(), vector("segment")).unwrap();
    let options = SubscriberOptions {
        start: Start::History(16),
        ..SubscriberOptions::default()
    };
    let mut subscriber = Subscriber::open(&topic, &options).unwrap();
    let mut buffer = Vec::new();
    for n in 1..3_u64 {
        let read = subscriber
            .read_timeout(&mut buffer, Duration::ZERO)
            .unwrap();
        let Read::Message(meta) = read else {
            panic!("{read:?}")
        };
        assert_eq!(buffer, format!("message{n}").as_bytes());
        let time_ns = 1_234_567_890_123_456_787 + n;
        assert_eq!((meta.sequence, meta.timestamp_ns), (n, time_ns));
    }
}

#[test]
fn the_info_of_a_segment_is_as_the_page_says() {
    let topic = Scratch::new();
    fs::write(topic.path(), vector("segment")).unwrap();
    let info = Info::read(&topic).unwrap();
    assert_eq!(info.geometry, geometry());
    assert_eq!(info.state, State::Dead);
    assert_eq!(info.content, ContentTag::of("text/plain"));
    assert_eq!(info.instance_id, 0x0123_4567_89ab_cdef);
    assert_eq!((info.published, info.epoch), (3, 0));
    assert_eq!(info.writer_pid, 12345);
    assert_eq!(info.last_publish_ns, 1_234_567_890_123_456_789);
    assert_eq!(info.realtime_offset_ns, 0x171b_37a1_aa32_4000);
    assert!(info.readers.is_empty());
}
