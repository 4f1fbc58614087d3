//! Where a message is copied to: small ones aside, for the process's own heap; large ones into the binary that is sent.

use rustler::{Binary, Env, NewBinary, OwnedBinary};

/// The BEAM keeps binaries of up to this many bytes on the heap of the process.
const HEAP_BINARY_LIMIT: usize = 64;

/// See the module.
pub enum Buffer {
    /// The bytes and how many of them count.
    Small([u8; HEAP_BINARY_LIMIT], usize),
    /// A binary of its own.
    Large(OwnedBinary),
}

impl Buffer {
    /// Room for `len` bytes.
    ///
    /// # Panics
    /// When memory is exhausted, as any allocation.
    pub fn with_len(len: usize) -> Self {
        if len <= HEAP_BINARY_LIMIT {
            return Self::Small([0; HEAP_BINARY_LIMIT], len);
        }
        Self::Large(OwnedBinary::new(len).expect("memory for a message"))
    }

    /// The bytes as a term.
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
