//! The buffer that a message is copied into: an array for small messages, which end up on a
//! process heap, and the binary that is sent for large ones.

use rustler::{Binary, Env, NewBinary, OwnedBinary};

/// The largest binary in bytes that the BEAM stores on a process heap.
const HEAP_BINARY_LIMIT: usize = 64;

/// The bytes of a message on their way to a term.
pub enum Buffer {
    /// The bytes and the length of the message.
    Small([u8; HEAP_BINARY_LIMIT], usize),
    /// A binary outside process heaps.
    Large(OwnedBinary),
}

impl Buffer {
    /// Returns a buffer of `len` bytes.
    ///
    /// # Panics
    /// When memory is exhausted.
    pub fn with_len(len: usize) -> Self {
        if len <= HEAP_BINARY_LIMIT {
            return Self::Small([0; HEAP_BINARY_LIMIT], len);
        }
        Self::Large(OwnedBinary::new(len).expect("memory for a message"))
    }

    /// Converts the buffer into a term.
    pub fn into_binary(self, env: Env<'_>) -> Binary<'_> {
        match self {
            Self::Small(bytes, len) => {
                let mut binary = NewBinary::new(env, len);
                binary.as_mut_slice().copy_from_slice(&bytes[..len]);
                binary.into()
            }
            Self::Large(binary) => binary.release(env),
        }
    }
}

impl AsMut<[u8]> for Buffer {
    fn as_mut(&mut self) -> &mut [u8] {
        match self {
            Self::Small(bytes, len) => &mut bytes[..*len],
            Self::Large(binary) => binary.as_mut_slice(),
        }
    }
}
