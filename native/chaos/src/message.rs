//! The messages of a run. Each one contains its identity and a checksum.
//!
//! | offset | field |
//! |---|---|
//! | 0 u32 | number of the topic in the plan |
//! | 4 u32 | length of the message in bytes |
//! | 8 u64 | writer: a random number for each life of a publisher |
//! | 16 u64 | instance ID of the segment |
//! | 24 u64 | sequence number |
//! | 32 u32 | CRC-32 (IEEE 802.3) of all other bytes |
//! | 36 | body, computed from writer and sequence number |

use crc32fast::Hasher;

/// The number of bytes before the body, which is the length of the shortest message.
pub const HEADER: usize = 36;
const CHECKSUM: std::ops::Range<usize> = 32..36;

/// The identity of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// The topic.
    pub topic: u32,
    /// The life of the publisher.
    pub writer: u64,
    /// The segment.
    pub instance: u64,
    /// The sequence number.
    pub sequence: u64,
}

/// Writes a message of `len` bytes to `buffer`, of [`HEADER`] bytes if `len` is less.
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

/// Returns the identity and checksum of a message. Returns `None` if the message is damaged or
/// not the one of this topic and sequence number.
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
    fn messages_of_all_lengths_verify() {
        for len in [0, 36, 37, 44, 100, 4096, 100_000] {
            let message = message(len);
            assert_eq!(message.len(), len.max(HEADER));
            assert_eq!(verify(&message, 3, 12).unwrap().0, IDENTITY);
        }
    }

    #[test]
    fn each_changed_bit_is_detected() {
        let sound = message(100);
        for bit in 0..800 {
            let mut damaged = sound.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(verify(&damaged, 3, 12), None, "bit {bit}");
        }
    }

    #[test]
    fn halves_of_two_messages_are_detected() {
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
    fn an_intact_message_of_another_topic_or_number_is_detected() {
        assert_eq!(verify(&message(100), 4, 12), None);
        assert_eq!(verify(&message(100), 3, 13), None);
        assert_eq!(verify(&message(100)[..99], 3, 12), None);
        assert_eq!(verify(&message(100)[..10], 3, 12), None);
    }
}
