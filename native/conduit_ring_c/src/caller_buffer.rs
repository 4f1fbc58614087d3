//! A buffer of the caller that messages are read into.

use std::ffi::c_void;

use crate::failure::Failure;
use crate::pointer;

/// A buffer of the caller.
#[derive(Clone, Copy)]
pub(crate) struct CallerBuffer {
    at: *mut u8,
    pub(crate) capacity: usize,
}

/// The destination of a message: the caller's buffer if the message fits, otherwise one of ours.
pub(crate) enum Target {
    Caller(CallerBuffer),
    Own(Vec<u8>),
}

impl CallerBuffer {
    /// Checks the pointer and size of a buffer.
    ///
    /// # Safety
    /// `buffer` is null or has `capacity` bytes that no other thread uses for as long as the
    /// result exists.
    pub(crate) unsafe fn new(
        buffer: *mut c_void,
        capacity: usize,
    ) -> Result<CallerBuffer, Failure> {
        pointer::check_len(capacity, "buffer")?;
        if buffer.is_null() && capacity > 0 {
            return Err(Failure::invalid("buffer is NULL"));
        }
        Ok(CallerBuffer {
            at: buffer.cast(),
            capacity,
        })
    }

    /// Returns the destination of a message of `len` bytes.
    pub(crate) fn prepare(self, len: usize) -> Target {
        if len <= self.capacity {
            Target::Caller(CallerBuffer {
                capacity: len,
                ..self
            })
        } else {
            Target::Own(vec![0; len])
        }
    }

    /// Copies a message into the buffer if it fits.
    pub(crate) fn place(self, message: Vec<u8>) -> Target {
        match self.prepare(message.len()) {
            Target::Caller(mut buffer) => {
                buffer.as_mut().copy_from_slice(&message);
                Target::Caller(buffer)
            }
            Target::Own(_) => Target::Own(message),
        }
    }
}

impl AsMut<[u8]> for CallerBuffer {
    fn as_mut(&mut self) -> &mut [u8] {
        if self.capacity == 0 {
            return &mut [];
        }
        // SAFETY: not null; the caller of `new` guarantees the size and exclusive use.
        unsafe { std::slice::from_raw_parts_mut(self.at, self.capacity) }
    }
}

impl AsMut<[u8]> for Target {
    fn as_mut(&mut self) -> &mut [u8] {
        match self {
            Target::Caller(buffer) => buffer.as_mut(),
            Target::Own(buffer) => buffer,
        }
    }
}
