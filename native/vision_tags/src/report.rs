//! The contents of a detections message: the clearest tags and the frame's time. Pure.

use ganglion_messages::frame::{CLOCK_MONOTONIC_RAW, FrameHeader};
use ganglion_messages::stamp::Stamp;
use ganglion_messages::tags::{TagDetection, largest_message};

/// The most tags in a message. Of more tags, the clearest are kept.
pub const MOST_DETECTIONS: usize = 64;

const LONGEST_FAMILY: usize = 16;
const LONGEST_TOPIC: usize = 200;

/// The size of the largest message.
pub(crate) const LARGEST_MESSAGE: usize =
    largest_message(MOST_DETECTIONS, LONGEST_FAMILY, LONGEST_TOPIC);

/// Returns the capture time of a frame by `CLOCK_MONOTONIC_RAW`: the header's timestamp, or the
/// time of publication if the header uses another clock.
pub(crate) fn capture_time_ns(header: &FrameHeader, published_ns: u64) -> u64 {
    match header.clock_id {
        CLOCK_MONOTONIC_RAW => header.timestamp_ns,
        _ => published_ns,
    }
}

/// Converts a time of `CLOCK_MONOTONIC_RAW` to wall time.
pub(crate) fn wall_time(time_ns: u64, realtime_offset_ns: i64) -> Stamp {
    let time_ns = i64::try_from(time_ns).unwrap_or(i64::MAX);
    Stamp::from_unix_ns(time_ns.saturating_add(realtime_offset_ns))
}

/// Returns at most `most` detections, the clearest ones, in their order.
pub(crate) fn clearest(mut detections: Vec<TagDetection>, most: usize) -> Vec<TagDetection> {
    let margin = |index: &usize| detections[*index].decision_margin;
    let mut ranking: Vec<usize> = (0..detections.len()).collect();
    ranking.sort_by(|one, other| margin(other).total_cmp(&margin(one)));
    ranking.truncate(most);
    let mut index = 0..;
    detections.retain(|_| index.next().is_some_and(|index| ranking.contains(&index)));
    detections
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::FAMILIES;
    use ganglion_messages::tags::{FrameSource, TagDetections};

    fn tag(id: i32, decision_margin: f32) -> TagDetection {
        TagDetection {
            id,
            decision_margin,
            ..TagDetection::default()
        }
    }

    #[test]
    fn of_too_many_tags_the_clearest_are_kept_in_their_order() {
        let tags = vec![tag(0, 5.0), tag(1, 1.0), tag(2, 5.0), tag(3, 9.0)];
        let ids = |most| -> Vec<i32> {
            let kept = clearest(tags.clone(), most);
            kept.iter().map(|tag| tag.id).collect()
        };
        assert_eq!(ids(4), [0, 1, 2, 3]);
        assert_eq!(ids(3), [0, 2, 3]);
        assert_eq!(ids(2), [0, 3]);
        assert_eq!(ids(1), [3]);
    }

    #[test]
    fn the_capture_time_is_the_headers_unless_it_uses_another_clock() {
        let header = FrameHeader::grey(1, 1, 77, 0);
        assert_eq!(capture_time_ns(&header, 99), 77);
        let foreign = FrameHeader {
            clock_id: 1,
            ..header
        };
        assert_eq!(capture_time_ns(&foreign, 99), 99);
    }

    #[test]
    fn a_hostile_time_stamp_converts_without_a_panic() {
        assert_eq!(wall_time(1_000_000_000, 500).unix_ns(), 1_000_000_500);
        wall_time(u64::MAX, i64::MAX);
        wall_time(0, i64::MIN);
    }

    #[test]
    fn the_largest_message_fits_a_slot() {
        let detections = TagDetections {
            frame_id: "x".repeat(LONGEST_TOPIC),
            detections: vec![
                TagDetection {
                    family: FAMILIES[0].into(),
                    ..TagDetection::default()
                };
                MOST_DETECTIONS
            ],
            source: Some(FrameSource::default()),
            ..TagDetections::default()
        };
        assert!(detections.encode().len() <= LARGEST_MESSAGE);
        assert!(FAMILIES.iter().all(|name| name.len() <= LONGEST_FAMILY));
    }
}
