//! Which encoding the messages of a topic have.

/// A hash of the name of an encoding, kept in the segment so that tools can tell what they see.
///
/// The publisher states the encoding in
/// [`PublisherOptions::content`](crate::PublisherOptions::content). The ring itself never looks
/// into a message. A publisher with another tag than its predecessor's makes a new segment, so
/// that all messages of one segment have one encoding.
///
/// ```
/// use conduit_ring::ContentTag;
///
/// const IMU: ContentTag = ContentTag::of("sensor_msgs/msg/Imu");
/// assert_ne!(IMU, ContentTag::RAW);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct ContentTag(u64);

impl ContentTag {
    /// The tag of bytes without a stated encoding.
    pub const RAW: ContentTag = ContentTag(0);

    /// Returns the tag of an encoding: the 64-bit FNV-1a hash of its name.
    pub const fn of(name: &str) -> ContentTag {
        let bytes = name.as_bytes();
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut i = 0;
        while i < bytes.len() {
            hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
            i += 1;
        }
        ContentTag(hash)
    }

    /// Makes a tag from the number that a segment holds.
    pub const fn from_value(value: u64) -> ContentTag {
        ContentTag(value)
    }

    /// Returns the number that a segment holds.
    pub const fn value(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_are_fnv_1a() {
        assert_eq!(ContentTag::of("").value(), 0xcbf2_9ce4_8422_2325);
        assert_eq!(ContentTag::of("a").value(), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(ContentTag::of("foobar").value(), 0x8594_4171_f739_67e8);
    }
}
