//! The names behind content tags.

use conduit_ring::ContentTag;
use ganglion_messages::{frame, imu, tags};

/// Encodings whose names are known; of those that are not decoded here the name is all there is to tell.
const ENCODINGS: &[&str] = &[
    frame::ENCODING,
    imu::ENCODING,
    tags::ENCODING,
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Range",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/BatteryState",
];

/// The encoding's name; `raw` for bytes of no stated encoding, the tag itself for one whose name is not known.
pub fn name(tag: ContentTag) -> String {
    if tag == ContentTag::RAW {
        return "raw".into();
    }
    let known = ENCODINGS.iter().find(|&&name| ContentTag::of(name) == tag);
    known.map_or_else(|| format!("{:#018x}", tag.value()), |&name| name.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tag_is_named_if_it_can_be() {
        assert_eq!(
            name(ContentTag::of("sensor_msgs/msg/Imu")),
            "sensor_msgs/msg/Imu"
        );
        assert_eq!(name(ContentTag::RAW), "raw");
        assert_eq!(name(ContentTag::from_value(0x12)), "0x0000000000000012");
    }
}
