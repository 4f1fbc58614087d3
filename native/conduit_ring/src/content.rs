//! Which encoding a topic's messages have.

/// A hash of the name of an encoding, kept in the segment so that tools can tell what they see.
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
    /// Bytes of no stated encoding.
    pub const RAW: ContentTag = ContentTag(0);

    /// The tag of an encoding: FNV-1a, 64 bits, of its name.
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

    /// A tag as it stands in a segment.
    pub const fn from_value(value: u64) -> ContentTag {
        ContentTag(value)
    }

    /// The number that stands in the segment.
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
