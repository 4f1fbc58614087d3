//! Pictures that no camera takes, which the detector's C code must survive.

use ganglion_messages::frame::{Frame, FrameHeader, GREY};
use ganglion_messages::tags::TagDetection;
use vision_tags::detector::{DECIMATIONS, DetectError, Settings, TagDetector};

fn detect(
    detector: &mut TagDetector,
    width: u32,
    height: u32,
    grey: impl FnMut(u32) -> u8,
) -> Vec<TagDetection> {
    let header = FrameHeader::grey(width, height, 0, 0);
    let pixels: Vec<u8> = (0..width * height).map(grey).collect();
    let data = &pixels[..];
    detector
        .detect(&Frame { header, data })
        .expect("detections")
}

/// Returns Marsaglia's xorshift: noise that is the same in each run.
fn noise(seed: u64) -> impl FnMut(u32) -> u8 {
    let mut state = seed | 1;
    move |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    }
}

fn detectors() -> impl Iterator<Item = TagDetector> {
    DECIMATIONS.into_iter().map(|quad_decimate| {
        TagDetector::new(Settings {
            quad_decimate,
            refine_edges: quad_decimate > 2.0,
            ..Settings::default()
        })
    })
}

#[test]
fn pictures_of_any_small_size_have_no_tags() {
    for mut detector in detectors() {
        for size in
            (0..70u32).flat_map(|width| [(width, 1), (1, width), (width, width), (width, 33)])
        {
            let (width, height) = (size.0.max(1), size.1.max(1));
            assert_eq!(detect(&mut detector, width, height, noise(7)), []);
        }
    }
}

#[test]
fn noise_stripes_and_chequers_do_no_harm() {
    for mut detector in detectors() {
        for seed in 0..4 {
            detect(&mut detector, 320, 240, noise(seed * 77 + 3));
            let mut coarse = noise(seed);
            detect(&mut detector, 319, 241, move |at| {
                if coarse(at) > 127 { 255 } else { 0 }
            });
        }
        for period in 1..9 {
            detect(&mut detector, 320, 240, |at| {
                if at % 320 / period % 2 == 0 { 255 } else { 0 }
            });
            detect(&mut detector, 320, 240, |at| {
                if (at % 320 / period + at / 320 / period) % 2 == 0 {
                    255
                } else {
                    0
                }
            });
        }
        for grey in [0, 127, 255] {
            assert_eq!(detect(&mut detector, 320, 240, |_| grey), []);
        }
    }
}

#[test]
fn a_frame_that_is_not_grey_or_too_large_is_rejected() {
    let mut detector = TagDetector::new(Settings::default());
    let yuyv = u32::from_le_bytes(*b"YUYV");
    let mut error = |header| detector.detect(&Frame { header, data: &[] }).unwrap_err();
    let colour = FrameHeader {
        fourcc: yuyv,
        ..FrameHeader::grey(64, 64, 0, 0)
    };
    assert_eq!(error(colour), DetectError::NotGrey(yuyv));
    assert_eq!(
        DetectError::NotGrey(yuyv).to_string(),
        "expected a frame in pixel format GREY, got: YUYV"
    );
    for (width, height) in [(32_768, 16), (16, 32_768), (32_000, 32_000)] {
        let header = FrameHeader {
            width,
            height,
            fourcc: GREY,
            ..FrameHeader::grey(1, 1, 0, 0)
        };
        assert_eq!(error(header), DetectError::TooLarge { width, height });
    }
}
