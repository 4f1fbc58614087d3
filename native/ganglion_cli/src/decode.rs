//! Decodes messages of known encodings into JSON values.

use conduit_ring::ContentTag;
use ganglion_messages::frame::{self, Frame};
use ganglion_messages::imu::{self, Imu};
use ganglion_messages::stamp::Stamp;
use ganglion_messages::tags::{self, FrameSource, TagDetection, TagDetections};
use serde_json::{Value, json};

/// Decodes a message. Returns `None` for an unknown encoding, and the reason as `Err` for bytes
/// that do not match their content tag.
pub fn decode(content: ContentTag, bytes: &[u8]) -> Option<Result<Value, String>> {
    if content == ContentTag::of(frame::ENCODING) {
        Some(
            Frame::decode(bytes)
                .map(|f| frame_value(&f))
                .map_err(|e| e.to_string()),
        )
    } else if content == ContentTag::of(imu::ENCODING) {
        Some(
            Imu::decode(bytes)
                .map(|i| imu_value(&i))
                .map_err(|e| e.to_string()),
        )
    } else if content == ContentTag::of(tags::ENCODING) {
        Some(
            TagDetections::decode(bytes)
                .map(|t| tags_value(&t))
                .map_err(|e| e.to_string()),
        )
    } else {
        None
    }
}

/// Formats bytes as two hexadecimal digits each.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns a frame's header without the pixels.
fn frame_value(frame: &Frame<'_>) -> Value {
    let header = &frame.header;
    json!({
        "width": header.width,
        "height": header.height,
        "fourcc": fourcc(header.fourcc),
        "stride": header.stride,
        "data_size": header.data_size,
        "timestamp_ns": header.timestamp_ns,
        "clock_id": header.clock_id,
        "plane_count": header.plane_count,
        "rotation": header.rotation,
        "colourspace": header.colourspace,
        "frame_id": header.frame_id,
        "exposure_us": header.exposure_us,
        "flags": header.flags,
    })
}

fn fourcc(code: u32) -> String {
    code.to_le_bytes().escape_ascii().to_string()
}

fn stamp(stamp: Stamp) -> Value {
    json!({"sec": stamp.sec, "nanosec": stamp.nanosec})
}

fn imu_value(imu: &Imu) -> Value {
    json!({
        "stamp": stamp(imu.stamp),
        "frame_id": imu.frame_id,
        "orientation": imu.orientation,
        "orientation_covariance": imu.orientation_covariance,
        "angular_velocity": imu.angular_velocity,
        "angular_velocity_covariance": imu.angular_velocity_covariance,
        "linear_acceleration": imu.linear_acceleration,
        "linear_acceleration_covariance": imu.linear_acceleration_covariance,
    })
}

fn tags_value(tags: &TagDetections) -> Value {
    let detections: Vec<Value> = tags.detections.iter().map(detection).collect();
    json!({
        "stamp": stamp(tags.stamp),
        "frame_id": tags.frame_id,
        "detections": detections,
        "source": tags.source.as_ref().map(source),
    })
}

fn detection(tag: &TagDetection) -> Value {
    json!({
        "family": tag.family,
        "id": tag.id,
        "hamming": tag.hamming,
        "goodness": tag.goodness,
        "decision_margin": tag.decision_margin,
        "centre": tag.centre,
        "corners": tag.corners,
        "homography": tag.homography,
    })
}

fn source(source: &FrameSource) -> Value {
    json!({
        "frame_sequence": source.frame_sequence,
        "frame_id": source.frame_id,
        "image_width": source.image_width,
        "image_height": source.image_height,
        "capture_time_ns": source.capture_time_ns,
        "angular_speed": source.angular_speed,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ganglion_messages::frame::FrameHeader;

    fn decoded(name: &str, bytes: &[u8]) -> Value {
        decode(ContentTag::of(name), bytes).unwrap().unwrap()
    }

    #[test]
    fn a_frame_is_decoded_to_its_header() {
        let header = FrameHeader::grey(4, 2, 1_000, 7);
        let value = decoded(frame::ENCODING, &[&header.encode()[..], &[0; 8]].concat());
        assert_eq!(
            (&value["fourcc"], &value["frame_id"]),
            (&json!("GREY"), &json!(7))
        );
        assert_eq!(value.get("data"), None);
    }

    #[test]
    fn samples_and_tags_are_decoded_completely() {
        let imu = Imu {
            frame_id: "imu".into(),
            angular_velocity: [0.5, 0.25, -1.0],
            ..Imu::default()
        };
        let value = decoded(imu::ENCODING, &imu.encode());
        assert_eq!(value["angular_velocity"], json!([0.5, 0.25, -1.0]));

        let tag = TagDetection {
            family: "tag36h11".into(),
            id: 3,
            ..TagDetection::default()
        };
        let tags = TagDetections {
            detections: vec![tag],
            ..TagDetections::default()
        };
        let value = decoded(tags::ENCODING, &tags.encode());
        assert_eq!(value["detections"][0]["id"], 3);
        assert_eq!(value["source"], Value::Null);
    }

    #[test]
    fn bytes_that_do_not_match_their_tag_have_a_reason_and_unknown_tags_have_none() {
        let decoded = decode(ContentTag::of(frame::ENCODING), b"pixels").unwrap();
        assert!(decoded.unwrap_err().contains("got: 6 bytes"));
        assert_eq!(decode(ContentTag::RAW, b"pixels"), None);
        assert_eq!(hex(&[0, 255, 16]), "00ff10");
    }
}
