//! How many slots a ring has and how long they are.

use crate::error::Error;
use crate::layout::{HEADER_LEN, SLOT_HEADER_LEN};

/// Number and length of a ring's slots. A value of this type is always within the limits.
///
/// There are two ways to state a geometry. conduit counts a slot's length *with* its 20-byte
/// header ([`Geometry::slots`]). A user thinks of messages ([`Geometry::depth`]).
///
/// Slots start on a cache line: their length in the file is rounded up to a multiple of 64. The
/// longest message is that of the length as given, whatever the rounding leaves.
///
/// # How to choose
///
/// The depth is how many messages a slow reader may be behind before it loses one. Two are the
/// minimum to write one while another is read; four suit large frames, and 16, the default, suit
/// samples. Every slot's memory is allocated when the topic is made.
///
/// ```
/// use conduit_ring::Geometry;
///
/// let by_slots = Geometry::slots(16, 4096)?;
/// assert_eq!(by_slots.max_message_size(), 4076);
///
/// let by_depth = Geometry::depth(10, 4076)?;
/// assert_eq!(by_depth, by_slots);
/// assert_eq!(by_depth, Geometry::default());
///
/// let uneven = Geometry::slots(16, 4100)?;
/// assert_eq!((uneven.slot_size(), uneven.max_message_size()), (4160, 4080));
/// # Ok::<(), conduit_ring::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Geometry {
    slot_count: u32,
    slot_size: u32,
    max_message_size: u32,
}

impl Geometry {
    /// The length of the shortest slot: a header and one byte.
    pub const MIN_SLOT_SIZE: u32 = SLOT_HEADER_LEN as u32 + 1;
    /// The length of the longest slot: 1 GiB.
    pub const MAX_SLOT_SIZE: u32 = 1 << 30;
    /// The largest number of slots.
    pub const MAX_SLOT_COUNT: u32 = 1 << 20;

    /// Makes the geometry of `slot_count` slots of `slot_size` bytes each, the slot's 20-byte
    /// header included.
    ///
    /// # Errors
    /// [`Error::InvalidGeometry`] unless `slot_count` is a power of two up to
    /// [`MAX_SLOT_COUNT`](Geometry::MAX_SLOT_COUNT) and `slot_size` is between
    /// [`MIN_SLOT_SIZE`](Geometry::MIN_SLOT_SIZE) and [`MAX_SLOT_SIZE`](Geometry::MAX_SLOT_SIZE).
    /// On a 32-bit machine the whole segment must also fit into 2 GiB.
    pub fn slots(slot_count: u32, slot_size: u32) -> Result<Geometry, Error> {
        let given = Geometry::exact(slot_count, slot_size)?;
        let rounded = Geometry::exact(slot_count, slot_size.next_multiple_of(64))?;
        Ok(rounded.limited(given.max_message_size))
    }

    /// Makes the geometry of a ring that keeps at least the last `depth` messages of up to
    /// `max_message_size` bytes each.
    ///
    /// The depth is rounded up to a power of two, and the size so that slots fill whole cache
    /// lines of the file.
    ///
    /// # Errors
    /// [`Error::InvalidGeometry`] when depth or size is 0 or beyond the limits of
    /// [`Geometry::slots`].
    pub fn depth(depth: u32, max_message_size: u32) -> Result<Geometry, Error> {
        let invalid = || Error::InvalidGeometry {
            reason: format!(
                "expected a depth of 1..={} and messages of 1..={} bytes, got: a depth of \
                 {depth} and messages of {max_message_size} bytes",
                Self::MAX_SLOT_COUNT,
                Self::MAX_SLOT_SIZE - SLOT_HEADER_LEN as u32
            ),
        };
        if depth == 0 {
            return Err(invalid());
        }
        let slot_count = depth.checked_next_power_of_two().ok_or_else(invalid)?;
        let slot_size = max_message_size
            .checked_add(SLOT_HEADER_LEN as u32)
            .ok_or_else(invalid)?;
        Geometry::slots(slot_count, slot_size).map_err(|_| invalid())
    }

    /// Makes a geometry as a segment states it, with nothing rounded.
    pub(crate) fn exact(slot_count: u32, slot_size: u32) -> Result<Geometry, Error> {
        let geometry = Geometry {
            slot_count,
            slot_size,
            max_message_size: slot_size.saturating_sub(SLOT_HEADER_LEN as u32),
        };
        let accepted = slot_count.is_power_of_two()
            && slot_count <= Self::MAX_SLOT_COUNT
            && (Self::MIN_SLOT_SIZE..=Self::MAX_SLOT_SIZE).contains(&slot_size)
            && isize::try_from(geometry.segment_len()).is_ok();
        accepted
            .then_some(geometry)
            .ok_or_else(|| Error::InvalidGeometry {
                reason: format!(
                    "expected a power of two up to {} of slots of {}..={} bytes, got: \
                 {slot_count} slots of {slot_size} bytes",
                    Self::MAX_SLOT_COUNT,
                    Self::MIN_SLOT_SIZE,
                    Self::MAX_SLOT_SIZE
                ),
            })
    }

    /// Returns the same slots for messages of up to `max_message_size` bytes. 0, and a size
    /// longer than a slot, stand for a slot's length.
    pub(crate) fn limited(self, max_message_size: u32) -> Geometry {
        let accepted = 1..=self.capacity() as u32;
        Geometry {
            max_message_size: if accepted.contains(&max_message_size) {
                max_message_size
            } else {
                self.capacity() as u32
            },
            ..self
        }
    }

    /// Returns whether the slots of both lie at the same places.
    pub(crate) fn has_slots_of(&self, other: &Geometry) -> bool {
        (self.slot_count, self.slot_size) == (other.slot_count, other.slot_size)
    }

    /// Returns the number of slots, a power of two.
    pub fn slot_count(&self) -> u32 {
        self.slot_count
    }

    /// Returns the length of a slot in the file in bytes, its 20-byte header included.
    pub fn slot_size(&self) -> u32 {
        self.slot_size
    }

    /// Returns the length of the longest message that is accepted, in bytes. It is the slot's
    /// length as it was given, without its header.
    pub fn max_message_size(&self) -> usize {
        self.max_message_size as usize
    }

    /// Returns the bytes of a slot behind its header.
    pub(crate) fn capacity(&self) -> usize {
        self.slot_size as usize - SLOT_HEADER_LEN
    }

    /// Returns the length of the whole segment in bytes.
    pub fn segment_len(&self) -> u64 {
        HEADER_LEN as u64 + u64::from(self.slot_count) * u64::from(self.slot_size)
    }

    /// Returns where the slot of a message begins in the segment.
    #[inline]
    pub(crate) fn slot_offset(&self, sequence: u64) -> usize {
        let index = sequence as u32 & (self.slot_count - 1);
        HEADER_LEN + index as usize * self.slot_size as usize
    }
}

impl Default for Geometry {
    /// Returns conduit's default: 16 slots of 4096 bytes, for messages of up to 4076 bytes.
    fn default() -> Self {
        Geometry {
            slot_count: 16,
            slot_size: 4096,
            max_message_size: 4096 - SLOT_HEADER_LEN as u32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slot_count_that_is_no_power_of_two_is_refused_saying_what_was_given() {
        let error = Geometry::slots(12, 4096).unwrap_err().to_string();
        assert!(error.contains("12 slots of 4096 bytes"), "{error}");
        assert!(Geometry::slots(0, 4096).is_err());
        assert!(Geometry::slots(1 << 21, 64).is_err());
    }

    #[test]
    fn slot_sizes_are_accepted_from_21_bytes_to_the_cap() {
        assert!(Geometry::slots(1, 20).is_err());
        assert_eq!(Geometry::slots(1, 21).unwrap().slot_size(), 64);
        assert!(Geometry::slots(1, Geometry::MAX_SLOT_SIZE).is_ok());
        assert!(Geometry::slots(1, Geometry::MAX_SLOT_SIZE + 1).is_err());
        assert!(Geometry::slots(1, u32::MAX).is_err());
    }

    #[test]
    fn the_longest_message_is_that_of_the_size_as_given() {
        for slot_size in 21..=300 {
            let geometry = Geometry::slots(4, slot_size).unwrap();
            assert_eq!(geometry.slot_size() % 64, 0);
            assert_eq!(geometry.max_message_size(), slot_size as usize - 20);
            assert!(geometry.capacity() >= geometry.max_message_size());
            let by_depth = Geometry::depth(4, slot_size - 20).unwrap();
            assert_eq!(by_depth, geometry);
            assert!(geometry.has_slots_of(&Geometry::slots(4, geometry.slot_size()).unwrap()));
        }
        let whole = Geometry::slots(4, 128).unwrap();
        assert_eq!((whole.limited(0), whole.limited(109)), (whole, whole));
        assert_eq!(whole.limited(108), whole);
        assert_eq!(whole.limited(1).max_message_size(), 1);
    }

    #[test]
    fn depth_rounds_up_to_a_power_of_two_and_adds_the_slot_header() {
        let geometry = Geometry::depth(5, 100).unwrap();
        assert_eq!((geometry.slot_count(), geometry.slot_size()), (8, 128));
        assert!(Geometry::depth(0, 100).is_err());
        assert!(Geometry::depth(4, 0).is_err());
        assert!(Geometry::depth(u32::MAX, 100).is_err());
        assert!(Geometry::depth(4, u32::MAX).is_err());
    }

    #[test]
    fn messages_go_round_the_slots() {
        let geometry = Geometry::slots(4, 64).unwrap();
        assert_eq!(geometry.segment_len(), 1216 + 4 * 64);
        assert_eq!(geometry.slot_offset(0), 1216);
        assert_eq!(geometry.slot_offset(7), 1216 + 3 * 64);
        assert_eq!(geometry.slot_offset(u64::MAX), 1216 + 3 * 64);
    }
}
