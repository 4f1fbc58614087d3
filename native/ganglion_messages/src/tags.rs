//! `apriltag_msgs/msg/AprilTagDetectionArray`: the tags found in one camera frame, with a tail of
//! ours.
//!
//! The tail identifies the frame, gives its capture time by a clock that cannot be set, and the
//! robot's angular speed at that time. It follows the message's last field, where a reader of the
//! standard type stops, at the next multiple of 8:
//!
//! | offset | type | field | | offset | type | field |
//! |---|---|---|---|---|---|---|
//! | 0 | u32 | magic, "GNGT" | | 24 | u32 | image_height |
//! | 4 | u32 | version, 1 | | 28 | u32 | flags; bit 0: angular_speed is known |
//! | 8 | u64 | frame_sequence | | 32 | u64 | capture_time_ns |
//! | 16 | u32 | frame_id | | 40 | f64 | angular_speed, rad/s; 0 when not known |
//! | 20 | u32 | image_width | | 48 | | |

use crate::cdr::{CdrError, Reader, Writer};
use crate::stamp::Stamp;

/// The encoding's name. The ring's content tag is its hash.
pub const ENCODING: &str = "apriltag_msgs/msg/AprilTagDetectionArray";

const TAIL_MAGIC: u32 = u32::from_le_bytes(*b"GNGT");
const TAIL_VERSION: u32 = 1;
const TAIL_SIZE: usize = 48;
const ANGULAR_SPEED_KNOWN: u32 = 1;

/// The size of the shortest detection, one with an empty family.
const SMALLEST_DETECTION: usize = 4 + 4 * 4 + (2 + 8 + 9) * 8;

/// The tags found in one frame. The list may be empty.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TagDetections {
    /// Wall time of the frame's capture.
    pub stamp: Stamp,
    /// The name of the camera or of its coordinate frame.
    pub frame_id: String,
    /// The tags, in the detector's order.
    pub detections: Vec<TagDetection>,
    /// The frame in which the tags were found; `None` in messages of other detectors.
    pub source: Option<FrameSource>,
}

/// One tag. In pixel coordinates, the upper left corner of the image is (0, 0) and the centre of
/// its first pixel (0.5, 0.5).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TagDetection {
    /// The tag's family, such as `tag36h11`.
    pub family: String,
    /// The tag's number in its family.
    pub id: i32,
    /// Number of corrected bits.
    pub hamming: i32,
    /// A field of the standard message that the detector no longer fills: 0.
    pub goodness: f32,
    /// How clearly the detector could read the bits; higher is better.
    pub decision_margin: f32,
    /// Centre, x y.
    pub centre: [f64; 2],
    /// Corners of the black border in the detector's order: lower left, lower right, upper right,
    /// upper left for an upright tag.
    pub corners: [[f64; 2]; 4],
    /// Maps the tag's plane, with its corners at ±1, to pixels; row-major.
    pub homography: [f64; 9],
}

/// Identifies the frame in which the tags were found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameSource {
    /// The frame's sequence number on its ring.
    pub frame_sequence: u64,
    /// The camera's own count of its frames.
    pub frame_id: u32,
    /// Pixels in a row.
    pub image_width: u32,
    /// Rows.
    pub image_height: u32,
    /// Capture time in nanoseconds of `CLOCK_MONOTONIC_RAW`.
    pub capture_time_ns: u64,
    /// Angular speed of the inertial measurement unit at that time, rad/s; `None` when not known.
    pub angular_speed: Option<f64>,
}

impl TagDetections {
    /// Encodes the message into `buffer` and replaces the buffer's contents.
    pub fn encode_into(&self, buffer: &mut Vec<u8>) {
        let mut writer = Writer::new(buffer);
        self.stamp.write(&mut writer);
        writer.string(&self.frame_id);
        writer.length(self.detections.len());
        for detection in &self.detections {
            detection.write(&mut writer);
        }
        if let Some(source) = &self.source {
            source.write(&mut writer);
        }
    }

    /// Encodes the message.
    pub fn encode(&self) -> Vec<u8> {
        let mut buffer = Vec::new();
        self.encode_into(&mut buffer);
        buffer
    }

    /// Decodes a message with or without our tail.
    ///
    /// # Errors
    /// A [`CdrError`] when the bytes are not this message, or when the tail is truncated.
    pub fn decode(message: &[u8]) -> Result<TagDetections, CdrError> {
        let mut reader = Reader::new(message)?;
        let stamp = Stamp::read(&mut reader)?;
        let frame_id = reader.string()?.to_owned();
        let count = reader.length(SMALLEST_DETECTION)?;
        let detections = (0..count)
            .map(|_| TagDetection::read(&mut reader))
            .collect::<Result<_, _>>()?;
        Ok(TagDetections {
            stamp,
            frame_id,
            detections,
            source: FrameSource::read(reader)?,
        })
    }
}

impl TagDetection {
    fn write(&self, writer: &mut Writer) {
        writer.string(&self.family);
        writer.i32(self.id);
        writer.i32(self.hamming);
        writer.f32(self.goodness);
        writer.f32(self.decision_margin);
        writer.f64s(&self.centre);
        writer.f64s(self.corners.as_flattened());
        writer.f64s(&self.homography);
    }

    fn read(reader: &mut Reader<'_>) -> Result<TagDetection, CdrError> {
        Ok(TagDetection {
            family: reader.string()?.to_owned(),
            id: reader.i32()?,
            hamming: reader.i32()?,
            goodness: reader.f32()?,
            decision_margin: reader.f32()?,
            centre: reader.f64s()?,
            corners: [
                reader.f64s()?,
                reader.f64s()?,
                reader.f64s()?,
                reader.f64s()?,
            ],
            homography: reader.f64s()?,
        })
    }
}

impl FrameSource {
    fn write(&self, writer: &mut Writer) {
        let known = self.angular_speed.map_or(0, |_| ANGULAR_SPEED_KNOWN);
        writer.align(8);
        writer.u32(TAIL_MAGIC);
        writer.u32(TAIL_VERSION);
        writer.u64(self.frame_sequence);
        writer.u32(self.frame_id);
        writer.u32(self.image_width);
        writer.u32(self.image_height);
        writer.u32(known);
        writer.u64(self.capture_time_ns);
        writer.f64(self.angular_speed.unwrap_or(0.0));
    }

    /// Reads the tail. Returns `None` when nothing or something unknown follows the standard
    /// message.
    fn read(mut reader: Reader<'_>) -> Result<Option<FrameSource>, CdrError> {
        if !is_tail(reader.clone()) {
            return Ok(None);
        }
        reader.align(8)?;
        reader.u64()?;
        let frame_sequence = reader.u64()?;
        let frame_id = reader.u32()?;
        let image_width = reader.u32()?;
        let image_height = reader.u32()?;
        let known = reader.u32()? & ANGULAR_SPEED_KNOWN != 0;
        let capture_time_ns = reader.u64()?;
        let angular_speed = reader.f64()?;
        Ok(Some(FrameSource {
            frame_sequence,
            frame_id,
            image_width,
            image_height,
            capture_time_ns,
            angular_speed: known.then_some(angular_speed),
        }))
    }
}

fn is_tail(mut reader: Reader<'_>) -> bool {
    reader.align(8).is_ok() && reader.u32() == Ok(TAIL_MAGIC) && reader.u32() == Ok(TAIL_VERSION)
}

/// Returns the size of the largest message with at most `detections` detections, `family` bytes
/// of family name and `frame_id` bytes of frame id: the size that a slot of the ring needs.
pub const fn largest_message(detections: usize, family: usize, frame_id: usize) -> usize {
    // At most 8 bytes for a string's NUL, its padding and the padding of a later f64.
    let header = 4 + 8 + 4 + frame_id + 8 + 4;
    let detection = SMALLEST_DETECTION + family + 8;
    header + detections * detection + 8 + TAIL_SIZE
}
