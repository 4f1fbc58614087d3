//! The part of a segment's header that is set once, as a pure function of its bytes.
//!
//! Every check of a foreign file is here, before the file is mapped: `max_subscribers` is 16, the
//! geometry is within the limits and fits the file's real size, version and features are known,
//! and the checksum is right.

use crate::content::ContentTag;
use crate::crc32::crc32;
use crate::error::Fault;
use crate::geometry::Geometry;
use crate::layout::{
    CHECKSUM, CONTENT_TAG, EXT_MAGIC, FEATURES, HEADER_LEN, INSTANCE_ID, MAGIC, MAX_SUBSCRIBERS,
    MESSAGE_LIMIT, READERS, REQUIRED_FEATURES, SLOT_COUNT, SLOT_SIZE, STATE, STATE_LIVE, VERSION,
    VERSION_MAJOR, VERSION_MINOR,
};

/// The length of the part of the header that is set once, up to the message limit.
pub(crate) const FIXED_LEN: usize = MESSAGE_LIMIT.offset() + 4;

/// Who made a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Origin {
    /// A publisher with the extension.
    Native { instance_id: u64 },
    /// An unmodified conduit publisher.
    Legacy,
}

/// The facts that a reader or a successor needs before it maps a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    pub(crate) geometry: Geometry,
    pub(crate) content: ContentTag,
    pub(crate) origin: Origin,
}

impl Header {
    /// Checks the first bytes of a file of `file_len` bytes.
    pub(crate) fn decode(bytes: &[u8; FIXED_LEN], file_len: u64) -> Result<Header, Fault> {
        if file_len < HEADER_LEN as u64 {
            return Err(Fault::NotReady);
        }
        let (slot_count, slot_size) = (
            word(bytes, SLOT_COUNT.offset()),
            word(bytes, SLOT_SIZE.offset()),
        );
        if slot_count == 0 || slot_size == 0 {
            return Err(Fault::NotReady);
        }
        if word(bytes, MAX_SUBSCRIBERS.offset()) != READERS {
            return Err(Fault::MaxSubscribers);
        }
        let geometry = Geometry::exact(slot_count, slot_size).map_err(|_| Fault::Geometry)?;
        if file_len < geometry.segment_len() {
            return Err(Fault::Truncated);
        }
        if word(bytes, MAGIC.offset()) != EXT_MAGIC {
            return Ok(Header {
                geometry,
                content: ContentTag::RAW,
                origin: Origin::Legacy,
            });
        }
        Header::decode_extension(bytes, geometry)
    }

    fn decode_extension(bytes: &[u8; FIXED_LEN], geometry: Geometry) -> Result<Header, Fault> {
        let major = word(bytes, VERSION.offset()) as u16;
        if major != VERSION_MAJOR || word(bytes, FEATURES.offset()) & REQUIRED_FEATURES != 0 {
            return Err(Fault::Version);
        }
        if word(bytes, CHECKSUM.offset()) != checksum(bytes) {
            return Err(Fault::Checksum);
        }
        let content = ContentTag::from_value(long(bytes, CONTENT_TAG.offset()));
        let origin = Origin::Native {
            instance_id: long(bytes, INSTANCE_ID.offset()),
        };
        Ok(Header {
            geometry: geometry.limited(word(bytes, MESSAGE_LIMIT.offset())),
            content,
            origin,
        })
    }

    /// Writes the first bytes of a new segment, in the state live and still without the magic.
    pub(crate) fn encode(&self) -> [u8; FIXED_LEN] {
        let mut bytes = [0; FIXED_LEN];
        let geometry = self.geometry;
        let version = u32::from(VERSION_MAJOR) | u32::from(VERSION_MINOR) << 16;
        put_word(&mut bytes, SLOT_COUNT.offset(), geometry.slot_count());
        put_word(&mut bytes, SLOT_SIZE.offset(), geometry.slot_size());
        put_word(&mut bytes, MAX_SUBSCRIBERS.offset(), READERS);
        put_word(&mut bytes, VERSION.offset(), version);
        put_word(&mut bytes, STATE.offset(), STATE_LIVE);
        put_long(&mut bytes, INSTANCE_ID.offset(), self.instance_id());
        put_long(&mut bytes, CONTENT_TAG.offset(), self.content.value());
        put_word(&mut bytes, MESSAGE_LIMIT.offset(), message_limit(&geometry));
        let sum = checksum(&bytes);
        put_word(&mut bytes, CHECKSUM.offset(), sum);
        bytes
    }

    /// Returns the random number of the sequence of messages; 0 without the extension.
    pub(crate) fn instance_id(&self) -> u64 {
        match self.origin {
            Origin::Native { instance_id } => instance_id,
            Origin::Legacy => 0,
        }
    }

    /// Returns whether the segment has the extension.
    pub(crate) fn is_native(&self) -> bool {
        self.origin != Origin::Legacy
    }
}

/// Returns the value at [`MESSAGE_LIMIT`] for a geometry.
pub(crate) fn message_limit(geometry: &Geometry) -> u32 {
    if geometry.max_message_size() == geometry.capacity() {
        0
    } else {
        geometry.max_message_size() as u32
    }
}

/// Covers geometry and content tag, which never change.
fn checksum(bytes: &[u8; FIXED_LEN]) -> u32 {
    let mut covered = [0; 24];
    covered[..16].copy_from_slice(&bytes[..16]);
    covered[16..].copy_from_slice(&bytes[CONTENT_TAG.offset()..CONTENT_TAG.offset() + 8]);
    crc32(&covered)
}

fn word(bytes: &[u8; FIXED_LEN], at: usize) -> u32 {
    u32::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

fn long(bytes: &[u8; FIXED_LEN], at: usize) -> u64 {
    u64::from_le_bytes(std::array::from_fn(|i| bytes[at + i]))
}

fn put_word(bytes: &mut [u8; FIXED_LEN], at: usize, value: u32) {
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
}

fn put_long(bytes: &mut [u8; FIXED_LEN], at: usize, value: u64) {
    bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(geometry: Geometry, content: ContentTag) -> Header {
        Header {
            geometry,
            content,
            origin: Origin::Native { instance_id: 7 },
        }
    }

    fn encoded() -> [u8; FIXED_LEN] {
        let mut bytes = header(Geometry::default(), ContentTag::of("x")).encode();
        put_word(&mut bytes, MAGIC.offset(), EXT_MAGIC);
        bytes
    }

    fn len() -> u64 {
        Geometry::default().segment_len()
    }

    #[test]
    fn a_header_decodes_to_what_was_encoded() {
        let expected = header(Geometry::default(), ContentTag::of("x"));
        assert_eq!(Header::decode(&encoded(), len()), Ok(expected));
    }

    #[test]
    fn the_size_as_given_is_kept_beside_the_rounded_one() {
        let given = Geometry::slots(4, 4100).unwrap();
        let mut bytes = header(given, ContentTag::RAW).encode();
        put_word(&mut bytes, MAGIC.offset(), EXT_MAGIC);
        let read = |bytes: &[u8; FIXED_LEN]| Header::decode(bytes, given.segment_len()).unwrap();
        assert_eq!(read(&bytes).geometry, given);
        for no_limit in [0, 4141, u32::MAX] {
            put_word(&mut bytes, MESSAGE_LIMIT.offset(), no_limit);
            assert_eq!(read(&bytes).geometry, Geometry::slots(4, 4160).unwrap());
        }
    }

    #[test]
    fn without_the_magic_it_is_a_legacy_header() {
        let bytes = header(Geometry::default(), ContentTag::of("x")).encode();
        let header = Header::decode(&bytes, len()).unwrap();
        assert_eq!(
            (header.origin, header.content),
            (Origin::Legacy, ContentTag::RAW)
        );
    }

    #[test]
    fn each_kind_of_damage_has_its_fault() {
        let damaged = |at: usize, value: u32| {
            let mut bytes = encoded();
            put_word(&mut bytes, at, value);
            Header::decode(&bytes, len()).unwrap_err()
        };
        assert_eq!(damaged(0, 0), Fault::NotReady);
        assert_eq!(damaged(0, 3), Fault::Geometry);
        assert_eq!(damaged(0, 1 << 31), Fault::Geometry);
        assert_eq!(damaged(4, 20), Fault::Geometry);
        assert_eq!(damaged(4, u32::MAX), Fault::Geometry);
        assert_eq!(damaged(4, 8192), Fault::Truncated);
        assert_eq!(damaged(4, 2048), Fault::Checksum);
        assert_eq!(damaged(8, 17), Fault::MaxSubscribers);
        assert_eq!(damaged(12, 1), Fault::Checksum);
        assert_eq!(damaged(20, 2), Fault::Version);
        assert_eq!(damaged(24, 1 << 16), Fault::Version);
        assert_eq!(damaged(48, 1), Fault::Checksum);
        assert_eq!(damaged(60, 1), Fault::Checksum);
        assert_eq!(Header::decode(&encoded(), 1215), Err(Fault::NotReady));
        assert_eq!(Header::decode(&encoded(), len() - 1), Err(Fault::Truncated));
    }
}
