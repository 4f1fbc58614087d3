//! The names of encodings and topic states, the same in text and in JSON.

use conduit_ring::{ContentTag, State};
use ganglion_messages::{frame, imu, tags};

/// The encodings with known names. Not all of them are decoded here.
const ENCODINGS: &[&str] = &[
    frame::ENCODING,
    imu::ENCODING,
    tags::ENCODING,
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Range",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/BatteryState",
];

/// Returns the name of an encoding: `raw` for bytes of no stated encoding, the tag itself for an
/// unknown one.
pub fn encoding(tag: ContentTag) -> String {
    if tag == ContentTag::RAW {
        return "raw".into();
    }
    let known = ENCODINGS.iter().find(|&&name| ContentTag::of(name) == tag);
    known.map_or_else(|| format!("{:#018x}", tag.value()), |&name| name.into())
}

/// Returns the name of a topic's state.
pub fn state(state: State) -> &'static str {
    match state {
        State::Live => "live",
        State::Dead => "dead",
        State::Closed => "closed",
        State::Retired => "retired",
        State::Legacy => "legacy",
        _ => "unknown",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_tag_has_a_name_and_an_unknown_one_is_a_number() {
        assert_eq!(
            encoding(ContentTag::of("sensor_msgs/msg/Imu")),
            "sensor_msgs/msg/Imu"
        );
        assert_eq!(encoding(ContentTag::RAW), "raw");
        assert_eq!(encoding(ContentTag::from_value(0x12)), "0x0000000000000012");
    }
}
