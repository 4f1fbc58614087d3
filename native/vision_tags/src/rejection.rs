//! The reasons why a message of the frames' topic is rejected.

use crate::detector::DetectError;
use conduit_ring::ContentTag;
use ganglion_messages::frame::{self, FrameError};
use std::fmt;

/// The reason why a message of the frames' topic is rejected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Rejection {
    /// The topic's content tag states another encoding.
    NotFrames(u64),
    /// The message is not a frame.
    Frame(FrameError),
    /// The detector cannot use the frame.
    Detect(DetectError),
}

impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Rejection::NotFrames(tag) => write!(
                f,
                "expected the content tag of {}, got: {tag:016x}",
                frame::ENCODING
            ),
            Rejection::Frame(error) => error.fmt(f),
            Rejection::Detect(error) => error.fmt(f),
        }
    }
}

/// Checks a topic's content tag. A topic without a stated encoding is accepted, because each of
/// its messages is checked anyway.
pub(crate) fn check_content(content: Option<ContentTag>) -> Result<(), Rejection> {
    match content {
        Some(tag) if tag != ContentTag::RAW && tag != ContentTag::of(frame::ENCODING) => {
            Err(Rejection::NotFrames(tag.value()))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_and_messages_of_no_stated_encoding_are_accepted_and_others_rejected() {
        assert_eq!(check_content(None), Ok(()));
        assert_eq!(check_content(Some(ContentTag::RAW)), Ok(()));
        assert_eq!(check_content(Some(ContentTag::of("conduit/frame"))), Ok(()));
        let other = ContentTag::of("sensor_msgs/msg/Imu");
        let rejection = Rejection::NotFrames(other.value());
        assert_eq!(check_content(Some(other)), Err(rejection));
    }
}
