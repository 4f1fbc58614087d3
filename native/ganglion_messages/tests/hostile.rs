//! Decoding of bytes that a peer wrote by mistake or on purpose, and round trips of messages.

use ganglion_messages::cdr::CdrError;
use ganglion_messages::frame::{Frame, FrameError, FrameHeader, GREY};
use ganglion_messages::imu::Imu;
use ganglion_messages::stamp::Stamp;
use ganglion_messages::tags::{FrameSource, TagDetection, TagDetections, largest_message};
use proptest::array::{uniform3, uniform4, uniform9};
use proptest::collection::vec;
use proptest::prelude::*;

fn number() -> impl Strategy<Value = f64> {
    -1e9..1e9f64
}

fn stamp() -> impl Strategy<Value = Stamp> {
    any::<(i32, u32)>().prop_map(|(sec, nanosec)| Stamp { sec, nanosec })
}

fn imu() -> impl Strategy<Value = Imu> {
    (
        (stamp(), "[a-z_é]{0,20}"),
        (uniform4(number()), uniform9(number())),
        (uniform3(number()), uniform9(number())),
        (uniform3(number()), uniform9(number())),
    )
        .prop_map(
            |((stamp, frame_id), orientation, velocity, acceleration)| Imu {
                stamp,
                frame_id,
                orientation: orientation.0,
                orientation_covariance: orientation.1,
                angular_velocity: velocity.0,
                angular_velocity_covariance: velocity.1,
                linear_acceleration: acceleration.0,
                linear_acceleration_covariance: acceleration.1,
            },
        )
}

fn detection() -> impl Strategy<Value = TagDetection> {
    (
        ("[a-zA-Z0-9]{0,16}", any::<i32>(), any::<i32>()),
        (-1e6..1e6f32, -1e6..1e6f32),
        uniform9(number()),
        uniform9(number()),
    )
        .prop_map(
            |((family, id, hamming), (goodness, decision_margin), p, homography)| TagDetection {
                family,
                id,
                hamming,
                goodness,
                decision_margin,
                centre: [p[8], -p[8]],
                corners: [[p[0], p[1]], [p[2], p[3]], [p[4], p[5]], [p[6], p[7]]],
                homography,
            },
        )
}

fn source() -> impl Strategy<Value = FrameSource> {
    (
        any::<(u64, u32, u32, u32, u64)>(),
        proptest::option::of(number()),
    )
        .prop_map(
            |(
                (frame_sequence, frame_id, image_width, image_height, capture_time_ns),
                angular_speed,
            )| {
                FrameSource {
                    frame_sequence,
                    frame_id,
                    image_width,
                    image_height,
                    capture_time_ns,
                    angular_speed,
                }
            },
        )
}

fn tags() -> impl Strategy<Value = TagDetections> {
    (
        stamp(),
        "[a-z_é]{0,20}",
        vec(detection(), 0..6),
        proptest::option::of(source()),
    )
        .prop_map(|(stamp, frame_id, detections, source)| TagDetections {
            stamp,
            frame_id,
            detections,
            source,
        })
}

fn header() -> impl Strategy<Value = FrameHeader> {
    any::<([u8; 5], [u32; 7], u64)>().prop_map(|(bytes, words, timestamp_ns)| FrameHeader {
        flags: bytes[0],
        width: words[0],
        height: words[1],
        fourcc: if bytes[4] & 1 == 0 { GREY } else { words[2] },
        stride: words[3],
        data_size: words[4],
        timestamp_ns,
        clock_id: bytes[1],
        plane_count: bytes[4] & 3,
        rotation: bytes[2],
        colourspace: bytes[3],
        frame_id: words[5],
        exposure_us: words[6],
    })
}

/// Reads every byte of a frame, as a user would.
fn walk(message: &[u8]) -> Option<usize> {
    let frame = Frame::decode(message).ok()?;
    Some(frame.rows().map(<[u8]>::len).sum())
}

proptest! {
    #[test]
    fn an_imu_sample_survives_a_round_trip(imu in imu()) {
        prop_assert_eq!(Imu::decode(&imu.encode()), Ok(imu));
    }

    #[test]
    fn detections_survive_a_round_trip(tags in tags()) {
        prop_assert_eq!(TagDetections::decode(&tags.encode()), Ok(tags));
    }

    #[test]
    fn no_message_is_larger_than_its_maximum_size(tags in tags()) {
        let family = tags.detections.iter().map(|tag| tag.family.len()).max().unwrap_or(0);
        let largest = largest_message(tags.detections.len(), family, tags.frame_id.len());
        prop_assert!(tags.encode().len() <= largest);
    }

    #[test]
    fn a_small_frame_survives_a_round_trip(
        (width, height) in (1..40u32, 1..40u32),
        gap in 0..9u32,
        seed in any::<u8>(),
    ) {
        let stride = width + gap;
        let data_size = stride * height;
        let grey = FrameHeader::grey(width, height, 5, 6);
        let header = FrameHeader { stride, data_size, ..grey };
        let pixels: Vec<u8> = (0..data_size).map(|i| (i as u8).wrapping_add(seed)).collect();
        let message = [&header.encode()[..], &pixels].concat();
        let frame = Frame::decode(&message).unwrap();
        prop_assert_eq!(frame.header, header);
        for (y, row) in frame.rows().enumerate() {
            let start = y * stride as usize;
            prop_assert_eq!(row, &pixels[start..start + width as usize]);
        }
        prop_assert_eq!(frame.rows().count(), height as usize);
    }

    #[test]
    fn any_header_is_refused_or_has_all_its_rows(header in header(), len in 0..3000usize) {
        let message = [&header.encode()[..], &vec![7; len]].concat();
        if let Some(sum) = walk(&message) {
            let rows = if header.fourcc == GREY { header.height as usize } else { 0 };
            let expected = header.width as usize * rows;
            prop_assert_eq!(sum, expected);
        }
    }

    #[test]
    fn random_bytes_never_panic(bytes in vec(any::<u8>(), 0..600)) {
        let _ = walk(&bytes);
        let _ = Imu::decode(&bytes);
        let _ = TagDetections::decode(&bytes);
        let encapsulated = [&[0, 1, 0, 0], &bytes[..]].concat();
        let _ = Imu::decode(&encapsulated);
        let _ = TagDetections::decode(&encapsulated);
    }

    #[test]
    fn a_message_with_bytes_changed_never_panics(
        tags in tags(),
        imu in imu(),
        changes in vec(any::<(u16, u8)>(), 1..8),
    ) {
        for mut message in [tags.encode(), imu.encode()] {
            for (at, value) in &changes {
                let at = *at as usize % message.len();
                message[at] = *value;
            }
            let _ = TagDetections::decode(&message);
            let _ = Imu::decode(&message);
        }
    }

    #[test]
    fn a_message_cut_short_is_an_error(imu in imu(), cut in any::<prop::sample::Index>()) {
        let message = imu.encode();
        let cut = cut.index(message.len());
        prop_assert_eq!(Imu::decode(&message[..cut]), Err(CdrError::Truncated));
    }

    #[test]
    fn wall_time_survives_as_a_stamp(
        unix_ns in -2_000_000_000_000_000_000..2_000_000_000_000_000_000i64,
    ) {
        prop_assert_eq!(Stamp::from_unix_ns(unix_ns).unix_ns(), unix_ns);
    }
}

fn tags_message_with_count(count: u32) -> Vec<u8> {
    let mut message = TagDetections::default().encode();
    let at = message.len() - 4;
    message[at..].copy_from_slice(&count.to_le_bytes());
    message
}

#[test]
fn a_count_that_the_message_cannot_hold_is_refused_before_anything_is_allocated() {
    for count in [1, 1000, u32::MAX] {
        let message = tags_message_with_count(count);
        assert_eq!(TagDetections::decode(&message), Err(CdrError::Truncated));
    }
}

#[test]
fn a_string_longer_than_the_message_is_refused() {
    let mut message = Imu::default().encode();
    message[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(Imu::decode(&message), Err(CdrError::Truncated));
}

#[test]
fn a_string_without_its_nul_is_refused() {
    let mut message = Imu::default().encode();
    message[16] = b'x';
    assert_eq!(Imu::decode(&message), Err(CdrError::StringNotTerminated));
}

#[test]
fn a_string_that_is_not_utf8_is_refused() {
    let mut message = Imu {
        frame_id: "x".into(),
        ..Imu::default()
    }
    .encode();
    message[16] = 0xFF;
    assert_eq!(Imu::decode(&message), Err(CdrError::StringNotUtf8));
}

#[test]
fn the_error_for_big_endian_cdr_names_it() {
    let mut message = Imu::default().encode();
    message[1] = 0;
    assert_eq!(Imu::decode(&message), Err(CdrError::NotLittleEndianCdr));
}

#[test]
fn detections_of_a_foreign_detector_have_no_source() {
    let message = TagDetections::default().encode();
    assert_eq!(TagDetections::decode(&message).unwrap().source, None);
    let followed = [&message[..], &[1; 60]].concat();
    assert_eq!(TagDetections::decode(&followed).unwrap().source, None);
}

#[test]
fn a_tail_of_a_later_version_is_ignored() {
    let mut message = with_source().encode();
    let version = message.len() - 44;
    message[version] = 2;
    assert_eq!(TagDetections::decode(&message).unwrap().source, None);
}

#[test]
fn a_tail_cut_short_is_an_error() {
    let message = with_source().encode();
    assert_eq!(
        TagDetections::decode(&message[..message.len() - 1]),
        Err(CdrError::Truncated)
    );
}

fn with_source() -> TagDetections {
    TagDetections {
        source: Some(FrameSource::default()),
        ..TagDetections::default()
    }
}

#[test]
fn times_outside_the_range_of_ros_become_the_nearest_one_within_it() {
    assert_eq!(Stamp::from_unix_ns(i64::MAX).sec, i32::MAX);
    assert_eq!(Stamp::from_unix_ns(i64::MIN).sec, i32::MIN);
}

fn refusal(change: impl FnOnce(&mut FrameHeader)) -> FrameError {
    let mut header = FrameHeader::grey(4, 3, 0, 0);
    change(&mut header);
    let message = [&header.encode()[..], &[0; 12]].concat();
    Frame::decode(&message).unwrap_err()
}

#[test]
fn a_frame_is_refused_with_the_cause() {
    assert_eq!(Frame::decode(&[0; 43]), Err(FrameError::TooShort(43)));
    assert_eq!(Frame::decode(&[0; 44]), Err(FrameError::NotAFrame));
    assert_eq!(refusal(|h| h.width = 0), FrameError::Empty);
    assert_eq!(refusal(|h| h.height = 0), FrameError::Empty);
    assert_eq!(refusal(|h| h.plane_count = 0), FrameError::PlaneCount(0));
    assert_eq!(refusal(|h| h.plane_count = 2), FrameError::PlaneCount(2));
    let stride = FrameError::StrideTooSmall {
        stride: 3,
        width: 4,
    };
    assert_eq!(refusal(|h| h.stride = 3), stride);
    let truncated = |needed| FrameError::Truncated {
        needed,
        available: 12,
    };
    assert_eq!(refusal(|h| h.data_size = 13), truncated(13));
    assert_eq!(refusal(|h| h.height = 4), truncated(16));
    assert_eq!(refusal(|h| h.stride = 5), truncated(14));
}

#[test]
fn the_error_for_another_version_names_it() {
    let mut message = FrameHeader::grey(1, 1, 0, 0).encode().to_vec();
    message[2] = 9;
    assert_eq!(Frame::decode(&message), Err(FrameError::UnknownVersion(9)));
}

#[test]
fn the_last_row_need_not_be_padded_to_the_stride() {
    let header = FrameHeader {
        stride: 5,
        data_size: 9,
        ..FrameHeader::grey(4, 2, 0, 0)
    };
    let message = [&header.encode()[..], b"abcd.efgh"].concat();
    let rows: Vec<_> = Frame::decode(&message).unwrap().rows().collect();
    assert_eq!(rows, [b"abcd", b"efgh"]);
}
