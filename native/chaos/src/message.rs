//! Messages that prove themselves: each says what it is, and carries a checksum over all of it.
//!
//! | offset | field |
//! |---|---|
//! | 0 u32 | topic, by its number in the plan |
//! | 4 u32 | length of the whole message |
//! | 8 u64 | writer: random for each life of a publisher |
//! | 16 u64 | instance: the segment's number |
//! | 24 u64 | sequence number that the writer gave it |
//! | 32 u32 | CRC-32 (IEEE 802.3) of everything else |
//! | 36 | body: bytes that follow from writer and sequence |

use crc32fast::Hasher;

/// Bytes in front of the body, and so the length of the shortest message.
pub const HEADER: usize = 36;
const CHECKSUM: std::ops::Range<usize> = 32..36;

/// What a message says about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Which topic.
    pub topic: u32,
    /// Which life of a publisher.
    pub writer: u64,
    /// Which segment.
    pub instance: u64,
    /// Which message.
    pub sequence: u64,
}

/// Makes a message of `len` bytes, at least a header's, in `buffer`.
pub fn write(buffer: &mut Vec<u8>, identity: &Identity, len: usize) {
    let len = len.max(HEADER);
    buffer.clear();
    buffer.extend(identity.topic.to_le_bytes());
    buffer.extend((len as u32).to_le_bytes());
    buffer.extend(identity.writer.to_le_bytes());
    buffer.extend(identity.instance.to_le_bytes());
    buffer.extend(identity.sequence.to_le_bytes());
    buffer.extend([0; 4]);
    let word = identity.writer ^ identity.sequence.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let words = (len - HEADER).div_ceil(8);
    buffer.extend(std::iter::repeat_n(word.to_le_bytes(), words).flatten());
    buffer.truncate(len);
    let sum = checksum(buffer);
    buffer[CHECKSUM].copy_from_slice(&sum.to_le_bytes());
}

/// Reads a message's identity and checksum, if it is what was published: all of it, on this topic, at this number.
pub fn verify(message: &[u8], topic: u32, sequence: u64) -> Option<(Identity, u32)> {
    let (head, _) = message.split_first_chunk::<HEADER>()?;
    let word = |at: usize| u32::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let long = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let identity = Identity {
        topic: word(0),
        writer: long(8),
        instance: long(16),
        sequence: long(24),
    };
    let sum = word(CHECKSUM.start);
    let whole = word(4) as usize == message.len()
        && sum == checksum(message)
        && (identity.topic, identity.sequence) == (topic, sequence);
    whole.then_some((identity, sum))
}

fn checksum(message: &[u8]) -> u32 {
    let mut hasher = Hasher::new();
    hasher.update(&message[..CHECKSUM.start]);
    hasher.update(&message[CHECKSUM.end..]);
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY: Identity = Identity {
        topic: 3,
        writer: 0xDEAD_BEEF_0BAD_F00D,
        instance: 77,
        sequence: 12,
    };

    fn message(len: usize) -> Vec<u8> {
        let mut buffer = Vec::new();
        write(&mut buffer, &IDENTITY, len);
        buffer
    }

    #[test]
    fn a_message_of_any_length_is_what_was_written() {
        for len in [0, 36, 37, 44, 100, 4096, 100_000] {
            let message = message(len);
            assert_eq!(message.len(), len.max(HEADER));
            assert_eq!(verify(&message, 3, 12).unwrap().0, IDENTITY);
        }
    }

    #[test]
    fn every_changed_bit_is_noticed() {
        let sound = message(100);
        for bit in 0..800 {
            let mut damaged = sound.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(verify(&damaged, 3, 12), None, "bit {bit}");
        }
    }

    #[test]
    fn half_of_one_message_and_half_of_another_is_noticed() {
        let mut torn = message(1000);
        let mut other = Vec::new();
        let next = Identity {
            sequence: 13,
            ..IDENTITY
        };
        write(&mut other, &next, 1000);
        torn[500..].copy_from_slice(&other[500..]);
        assert_eq!(verify(&torn, 3, 12), None);
    }

    #[test]
    fn a_whole_message_elsewhere_is_noticed() {
        assert_eq!(verify(&message(100), 4, 12), None);
        assert_eq!(verify(&message(100), 3, 13), None);
        assert_eq!(verify(&message(100)[..99], 3, 12), None);
        assert_eq!(verify(&message(100)[..10], 3, 12), None);
    }
}
