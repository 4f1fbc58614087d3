//! Compares the encodings with the dumps of docs/wire-format.md, which were worked out by hand
//! and not by the code under test.

use ganglion_messages::frame::{Frame, FrameError, FrameHeader, GREY};
use ganglion_messages::imu::Imu;
use ganglion_messages::stamp::Stamp;
use ganglion_messages::tags::{FrameSource, TagDetection, TagDetections};

const PAGE: &str = include_str!("../../../docs/wire-format.md");

/// Returns the bytes of the dump with this name.
fn vector(name: &str) -> Vec<u8> {
    let (_, rest) = PAGE.split_once(&format!("\n```hex {name}\n")).unwrap();
    let (dump, _) = rest.split_once("\n```").unwrap();
    dump.lines()
        .flat_map(|line| line.split('#').next().unwrap_or("").split_whitespace())
        .map(|pair| u8::from_str_radix(pair, 16).expect("two hexadecimal digits"))
        .collect()
}

fn imu() -> Imu {
    Imu {
        stamp: Stamp {
            sec: 1_700_000_000,
            nanosec: 123_456_789,
        },
        frame_id: "imu_link".into(),
        orientation: [0.0, 0.0, 0.0, 1.0],
        orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        angular_velocity: [0.25, -1.5, 3.0],
        angular_velocity_covariance: [0.001, 0.0, 0.0, 0.0, 0.002, 0.0, 0.0, 0.0, 0.003],
        linear_acceleration: [0.1, -0.2, 9.80665],
        linear_acceleration_covariance: [0.04, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.06],
    }
}

fn tags() -> TagDetections {
    TagDetections {
        stamp: Stamp {
            sec: 1_700_000_001,
            nanosec: 5,
        },
        frame_id: "camera".into(),
        detections: vec![
            TagDetection {
                family: "tag36h11".into(),
                id: 7,
                hamming: 0,
                goodness: 0.0,
                decision_margin: 81.5,
                centre: [320.25, 240.75],
                corners: [
                    [300.5, 260.5],
                    [340.0, 261.0],
                    [340.5, 221.0],
                    [300.0, 220.5],
                ],
                homography: [20.0, 0.5, 320.25, -0.25, 20.5, 240.75, 0.001, -0.002, 1.0],
            },
            TagDetection {
                family: "tag36h11".into(),
                id: 586,
                hamming: 2,
                goodness: 0.0,
                decision_margin: 12.25,
                centre: [100.0, 50.0],
                corners: [[90.0, 60.0], [110.0, 60.0], [110.0, 40.0], [90.0, 40.0]],
                homography: [10.0, 0.0, 100.0, 0.0, 10.0, 50.0, 0.0, 0.0, 1.0],
            },
        ],
        source: Some(FrameSource {
            frame_sequence: (1 << 40) + 3,
            frame_id: 99,
            image_width: 640,
            image_height: 480,
            capture_time_ns: 123_456_789_012_345,
            angular_speed: Some(3.5),
        }),
    }
}

fn no_tags() -> TagDetections {
    TagDetections {
        stamp: Stamp::from_unix_ns(-1),
        frame_id: "cam".into(),
        detections: vec![],
        source: Some(FrameSource {
            image_width: 799,
            image_height: 533,
            capture_time_ns: 1,
            ..FrameSource::default()
        }),
    }
}

fn frame_header() -> FrameHeader {
    FrameHeader {
        flags: 0,
        width: 640,
        height: 480,
        fourcc: GREY,
        stride: 704,
        data_size: 704 * 480,
        timestamp_ns: 123_456_789_012_345,
        clock_id: 4,
        plane_count: 1,
        rotation: 2,
        colourspace: 3,
        frame_id: u32::MAX,
        exposure_us: 8333,
    }
}

#[test]
fn an_imu_sample_is_written_as_in_the_vector() {
    assert_eq!(imu().encode(), vector("imu"));
}

#[test]
fn an_imu_sample_is_read_as_in_the_vector() {
    let message = vector("imu");
    assert_eq!(Imu::decode(&message), Ok(imu()));
}

#[test]
fn detections_are_written_as_in_the_vector() {
    assert_eq!(tags().encode(), vector("tags"));
}

#[test]
fn detections_are_read_as_in_the_vector() {
    let message = vector("tags");
    assert_eq!(TagDetections::decode(&message), Ok(tags()));
}

#[test]
fn a_frame_without_tags_is_written_and_read_as_in_the_vector() {
    let message = vector("tags_none");
    assert_eq!(no_tags().encode(), message);
    assert_eq!(TagDetections::decode(&message), Ok(no_tags()));
}

#[test]
fn a_frame_header_is_written_as_in_the_vector() {
    let expected = vector("frame_header");
    assert_eq!(frame_header().encode()[..], expected[..]);
}

#[test]
fn a_frame_is_read_as_in_the_vector() {
    let mut message = vector("frame_header");
    message.resize(44 + 704 * 480, 9);
    let frame = Frame::decode(&message).expect("a frame");
    assert_eq!(frame.header, frame_header());
    assert_eq!(frame.rows().count(), 480);
    assert!(frame.rows().all(|row| row == [9; 640]));
}

#[test]
fn a_frame_header_without_its_pixels_is_truncated() {
    let message = vector("frame_header");
    assert_eq!(
        Frame::decode(&message),
        Err(FrameError::Truncated {
            needed: 704 * 480,
            available: 0
        })
    );
}
