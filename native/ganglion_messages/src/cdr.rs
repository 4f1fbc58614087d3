//! CDR, the Common Data Representation of DDS and ROS 2, in little-endian byte order.
//!
//! A message starts with four bytes of encapsulation: `00 01` (plain CDR, little-endian) and two
//! zero bytes of options. After them, each number is aligned to a multiple of its own size,
//! counted from the fifth byte; padding is zeros. A string is a u32 length that includes the
//! closing NUL, then the bytes and the NUL. A sequence is a u32 count and its elements. A fixed
//! array is its elements alone.
//!
//! Our messages need no more than these rules. The crates for CDR depend on serde and leave the
//! check of a hostile length to their caller.
//!
//! ```
//! use ganglion_messages::cdr::{Reader, Writer};
//!
//! let mut bytes = Vec::new();
//! let mut writer = Writer::new(&mut bytes);
//! writer.string("imu");
//! writer.f64(0.5);
//! assert_eq!(bytes.len(), 4 + 8 + 8);
//!
//! let mut reader = Reader::new(&bytes)?;
//! assert_eq!(reader.string()?, "imu");
//! assert_eq!(reader.f64()?, 0.5);
//! # Ok::<(), ganglion_messages::cdr::CdrError>(())
//! ```

use std::fmt;

/// The encapsulation header: plain CDR, little-endian, no options.
pub const ENCAPSULATION: [u8; 4] = [0x00, 0x01, 0x00, 0x00];

/// The reason why bytes are not the expected CDR message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CdrError {
    /// The first two bytes are not those of little-endian CDR.
    NotLittleEndianCdr,
    /// The message ends before its last field.
    Truncated,
    /// A string has no closing NUL.
    StringNotTerminated,
    /// A string is not UTF-8.
    StringNotUtf8,
}

impl fmt::Display for CdrError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            CdrError::NotLittleEndianCdr => "the message is not little-endian CDR",
            CdrError::Truncated => "the message ends before its last field",
            CdrError::StringNotTerminated => "a string has no closing NUL",
            CdrError::StringNotUtf8 => "a string is not UTF-8",
        })
    }
}

impl std::error::Error for CdrError {}

/// Writes one message into a buffer, which its owner may use again for the next message.
#[derive(Debug)]
pub struct Writer<'a> {
    buffer: &'a mut Vec<u8>,
}

impl<'a> Writer<'a> {
    /// Empties `buffer` and starts a message in it with [`ENCAPSULATION`].
    pub fn new(buffer: &'a mut Vec<u8>) -> Writer<'a> {
        buffer.clear();
        buffer.extend_from_slice(&ENCAPSULATION);
        Writer { buffer }
    }

    /// Writes zeros up to the next multiple of `size`, a power of two.
    pub fn align(&mut self, size: usize) {
        let body = self.buffer.len() - ENCAPSULATION.len();
        let padding = padding(body, size);
        self.buffer.resize(self.buffer.len() + padding, 0);
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        self.align(N);
        self.buffer.extend_from_slice(&bytes);
    }

    /// Writes a u32.
    pub fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    /// Writes an i32.
    pub fn i32(&mut self, value: i32) {
        self.number(value.to_le_bytes());
    }

    /// Writes a u64.
    pub fn u64(&mut self, value: u64) {
        self.number(value.to_le_bytes());
    }

    /// Writes an f32.
    pub fn f32(&mut self, value: f32) {
        self.number(value.to_le_bytes());
    }

    /// Writes an f64.
    pub fn f64(&mut self, value: f64) {
        self.number(value.to_le_bytes());
    }

    /// Writes a fixed array of f64.
    pub fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|&value| self.f64(value));
    }

    /// Writes a string.
    ///
    /// # Panics
    /// When the string has 4 GiB or more, so that its length does not fit a u32.
    pub fn string(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.buffer.extend_from_slice(text.as_bytes());
        self.buffer.push(0);
    }

    /// Writes the count of a sequence. The caller writes the elements.
    ///
    /// # Panics
    /// When `count` does not fit a u32.
    pub fn length(&mut self, count: usize) {
        self.u32(u32::try_from(count).expect("a CDR length fits a u32"));
    }
}

/// Reads one message field by field and checks each step against the size of the message.
#[derive(Debug, Clone)]
pub struct Reader<'a> {
    body: &'a [u8],
    position: usize,
}

impl<'a> Reader<'a> {
    /// Starts after the encapsulation of `message`.
    ///
    /// # Errors
    /// [`CdrError::Truncated`] when the message is shorter than the encapsulation,
    /// [`CdrError::NotLittleEndianCdr`] when it is not little-endian CDR. Every other method of
    /// the reader fails with [`CdrError::Truncated`] when the message ends before the field does.
    pub fn new(message: &'a [u8]) -> Result<Reader<'a>, CdrError> {
        match message.split_at_checked(ENCAPSULATION.len()) {
            Some(([0x00, 0x01, _, _], body)) => Ok(Reader { body, position: 0 }),
            Some(_) => Err(CdrError::NotLittleEndianCdr),
            None => Err(CdrError::Truncated),
        }
    }

    /// Returns the number of bytes left.
    pub fn remaining(&self) -> usize {
        self.body.len() - self.position
    }

    /// Skips to the next multiple of `size`, a power of two.
    pub fn align(&mut self, size: usize) -> Result<(), CdrError> {
        self.take(padding(self.position, size)).map(drop)
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], CdrError> {
        let (taken, _) = self.body[self.position..]
            .split_at_checked(count)
            .ok_or(CdrError::Truncated)?;
        self.position += count;
        Ok(taken)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], CdrError> {
        self.align(N)?;
        let bytes = self.take(N)?;
        bytes.try_into().map_err(|_| CdrError::Truncated)
    }

    /// Reads a u32.
    pub fn u32(&mut self) -> Result<u32, CdrError> {
        self.number().map(u32::from_le_bytes)
    }

    /// Reads an i32.
    pub fn i32(&mut self) -> Result<i32, CdrError> {
        self.number().map(i32::from_le_bytes)
    }

    /// Reads a u64.
    pub fn u64(&mut self) -> Result<u64, CdrError> {
        self.number().map(u64::from_le_bytes)
    }

    /// Reads an f32.
    pub fn f32(&mut self) -> Result<f32, CdrError> {
        self.number().map(f32::from_le_bytes)
    }

    /// Reads an f64.
    pub fn f64(&mut self) -> Result<f64, CdrError> {
        self.number().map(f64::from_le_bytes)
    }

    /// Reads a fixed array of f64.
    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], CdrError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Reads a string, borrowed from the message. A length of 0, which some writers use for "",
    /// is accepted.
    ///
    /// # Errors
    /// [`CdrError::StringNotTerminated`] and [`CdrError::StringNotUtf8`], beside
    /// [`CdrError::Truncated`].
    pub fn string(&mut self) -> Result<&'a str, CdrError> {
        let length = self.u32()? as usize;
        match self.take(length)?.split_last() {
            None => Ok(""),
            Some((0, text)) => std::str::from_utf8(text).map_err(|_| CdrError::StringNotUtf8),
            Some(_) => Err(CdrError::StringNotTerminated),
        }
    }

    /// Reads the count of a sequence whose elements take at least `smallest` bytes each.
    ///
    /// # Errors
    /// [`CdrError::Truncated`] when the rest of the message cannot hold that many elements, so
    /// that the result is safe to allocate by.
    pub fn length(&mut self, smallest: usize) -> Result<usize, CdrError> {
        let count = self.u32()? as usize;
        match count.checked_mul(smallest) {
            Some(bytes) if bytes <= self.remaining() => Ok(count),
            _ => Err(CdrError::Truncated),
        }
    }
}

fn padding(position: usize, size: usize) -> usize {
    position.wrapping_neg() & (size - 1)
}
