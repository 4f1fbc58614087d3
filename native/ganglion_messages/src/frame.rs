//! Camera frames: a header of 44 bytes, then the uncompressed pixels.
//!
//! | offset | type | field | | offset | type | field |
//! |---|---|---|---|---|---|---|
//! | 0 | u16 | magic, `43 4D` ("CM") | | 24 | u64 | timestamp_ns |
//! | 2 | u8 | version, 1 | | 32 | u8 | clock_id |
//! | 3 | u8 | flags | | 33 | u8 | plane_count |
//! | 4 | u32 | width, pixels | | 34 | u8 | rotation |
//! | 8 | u32 | height, pixels | | 35 | u8 | colourspace |
//! | 12 | u32 | fourcc, V4L2's | | 36 | u32 | frame_id |
//! | 16 | u32 | stride, bytes per row with padding | | 40 | u32 | exposure_us |
//! | 20 | u32 | data_size, bytes of pixels | | 44 | | the pixels |
//!
//! All fields are little-endian. Together with the 20 bytes that the ring puts in front of each
//! message, the header makes the pixels of a slot start on a cache line.

use std::fmt;

/// The encoding's name. The ring's content tag is its hash.
pub const ENCODING: &str = "conduit/frame";

/// The pixel format of 8-bit grey, V4L2's `V4L2_PIX_FMT_GREY`.
pub const GREY: u32 = u32::from_le_bytes(*b"GREY");

/// Linux's number of `CLOCK_MONOTONIC_RAW`, the clock of our frames.
pub const CLOCK_MONOTONIC_RAW: u8 = 4;

const MAGIC: u16 = 0x4D43;
const VERSION: u8 = 1;

/// The header of a frame, without magic and version.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameHeader {
    /// Reserved; 0.
    pub flags: u8,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// V4L2's code for the pixel format, such as [`GREY`].
    pub fourcc: u32,
    /// Bytes from the start of a row to the start of the next.
    pub stride: u32,
    /// Bytes of pixels behind the header.
    pub data_size: u32,
    /// Start of the exposure in nanoseconds of the clock `clock_id`.
    pub timestamp_ns: u64,
    /// Linux's number of that clock: [`CLOCK_MONOTONIC_RAW`] in our frames.
    pub clock_id: u8,
    /// Number of planes; 1 for grey.
    pub plane_count: u8,
    /// Mounting of the camera; 0 is upright.
    pub rotation: u8,
    /// V4L2's `enum v4l2_colorspace`; 0 means not stated.
    pub colourspace: u8,
    /// The camera's own count of its frames.
    pub frame_id: u32,
    /// Exposure time in µs; 0 means not known.
    pub exposure_us: u32,
}

impl FrameHeader {
    /// Bytes of an encoded header.
    pub const SIZE: usize = 44;

    /// Returns the header of a grey frame without padding between rows, stamped by
    /// [`CLOCK_MONOTONIC_RAW`].
    ///
    /// # Panics
    /// When the frame has 4 GiB or more.
    pub fn grey(width: u32, height: u32, timestamp_ns: u64, frame_id: u32) -> FrameHeader {
        FrameHeader {
            flags: 0,
            width,
            height,
            fourcc: GREY,
            stride: width,
            data_size: width
                .checked_mul(height)
                .expect("a frame is smaller than 4 GiB"),
            timestamp_ns,
            clock_id: CLOCK_MONOTONIC_RAW,
            plane_count: 1,
            rotation: 0,
            colourspace: 0,
            frame_id,
            exposure_us: 0,
        }
    }

    /// Encodes the header.
    pub fn encode(&self) -> [u8; FrameHeader::SIZE] {
        let mut bytes = [0; FrameHeader::SIZE];
        bytes[0..2].copy_from_slice(&MAGIC.to_le_bytes());
        bytes[2] = VERSION;
        bytes[3] = self.flags;
        bytes[4..8].copy_from_slice(&self.width.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.height.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.fourcc.to_le_bytes());
        bytes[16..20].copy_from_slice(&self.stride.to_le_bytes());
        bytes[20..24].copy_from_slice(&self.data_size.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.timestamp_ns.to_le_bytes());
        bytes[32] = self.clock_id;
        bytes[33] = self.plane_count;
        bytes[34] = self.rotation;
        bytes[35] = self.colourspace;
        bytes[36..40].copy_from_slice(&self.frame_id.to_le_bytes());
        bytes[40..44].copy_from_slice(&self.exposure_us.to_le_bytes());
        bytes
    }

    fn parse(bytes: &[u8; FrameHeader::SIZE]) -> Result<FrameHeader, FrameError> {
        if u16::from_le_bytes([bytes[0], bytes[1]]) != MAGIC {
            return Err(FrameError::NotAFrame);
        }
        if bytes[2] != VERSION {
            return Err(FrameError::UnknownVersion(bytes[2]));
        }
        Ok(FrameHeader {
            flags: bytes[3],
            width: u32_at(bytes, 4),
            height: u32_at(bytes, 8),
            fourcc: u32_at(bytes, 12),
            stride: u32_at(bytes, 16),
            data_size: u32_at(bytes, 20),
            timestamp_ns: u64::from(u32_at(bytes, 24)) | u64::from(u32_at(bytes, 28)) << 32,
            clock_id: bytes[32],
            plane_count: bytes[33],
            rotation: bytes[34],
            colourspace: bytes[35],
            frame_id: u32_at(bytes, 36),
            exposure_us: u32_at(bytes, 40),
        })
    }

    /// Checks the rules of every pixel format, and those of [`GREY`].
    fn check(&self, available: usize) -> Result<(), FrameError> {
        if self.width == 0 || self.height == 0 {
            return Err(FrameError::Empty);
        }
        if self.plane_count == 0 {
            return Err(FrameError::PlaneCount(0));
        }
        if self.data_size as usize > available {
            return Err(FrameError::Truncated {
                needed: u64::from(self.data_size),
                available: available as u64,
            });
        }
        if self.fourcc == GREY {
            return self.check_grey();
        }
        Ok(())
    }

    fn check_grey(&self) -> Result<(), FrameError> {
        if self.plane_count != 1 {
            return Err(FrameError::PlaneCount(self.plane_count));
        }
        if self.stride < self.width {
            return Err(FrameError::StrideTooSmall {
                stride: self.stride,
                width: self.width,
            });
        }
        let needed = u64::from(self.stride) * u64::from(self.height - 1) + u64::from(self.width);
        if needed > u64::from(self.data_size) {
            return Err(FrameError::Truncated {
                needed,
                available: u64::from(self.data_size),
            });
        }
        Ok(())
    }
}

fn u32_at(bytes: &[u8; FrameHeader::SIZE], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// The reason why a message is not a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameError {
    /// The message is shorter than a header: its size in bytes.
    TooShort(usize),
    /// The message does not start with "CM".
    NotAFrame,
    /// The header has an unknown version.
    UnknownVersion(u8),
    /// Width or height is 0.
    Empty,
    /// The pixel format cannot have this number of planes.
    PlaneCount(u8),
    /// The rows overlap.
    StrideTooSmall {
        /// Bytes from row to row.
        stride: u32,
        /// Bytes in a row.
        width: u32,
    },
    /// The message has fewer pixels than the header says.
    Truncated {
        /// Bytes that the header implies.
        needed: u64,
        /// Bytes in the message.
        available: u64,
    },
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FrameError::TooShort(size) => write!(
                f,
                "expected a frame header of {} bytes, got: {size} bytes",
                FrameHeader::SIZE
            ),
            FrameError::NotAFrame => f.write_str("expected a frame, which starts with \"CM\""),
            FrameError::UnknownVersion(version) => write!(
                f,
                "expected version {VERSION} of the frame header, got: version {version}"
            ),
            FrameError::Empty => f.write_str("frame has no pixels"),
            FrameError::PlaneCount(count) => {
                write!(f, "frame has an impossible number of planes: {count}")
            }
            FrameError::StrideTooSmall { stride, width } => write!(
                f,
                "expected a stride of at least {width} bytes, got: {stride}"
            ),
            FrameError::Truncated { needed, available } => write!(
                f,
                "expected {needed} bytes of pixels, got: {available} bytes"
            ),
        }
    }
}

impl std::error::Error for FrameError {}

/// A frame inside a message: its header, checked against the size of the message, and its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame<'a> {
    /// The header.
    pub header: FrameHeader,
    /// `data_size` bytes of pixels.
    pub data: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Decodes a message. Bytes after the pixels are ignored.
    ///
    /// For [`GREY`] the result has all rows. For other pixel formats only `data_size` is checked.
    ///
    /// # Errors
    /// A [`FrameError`] that names the first field that is wrong.
    pub fn decode(message: &'a [u8]) -> Result<Frame<'a>, FrameError> {
        let (head, rest) = message
            .split_first_chunk::<{ FrameHeader::SIZE }>()
            .ok_or(FrameError::TooShort(message.len()))?;
        let header = FrameHeader::parse(head)?;
        header.check(rest.len())?;
        Ok(Frame {
            header,
            data: &rest[..header.data_size as usize],
        })
    }

    /// Iterates over the rows of a grey frame from top to bottom, `width` bytes each without
    /// padding. Yields nothing for other formats.
    pub fn rows(&self) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let is_grey = self.header.fourcc == GREY;
        let width = self.header.width as usize;
        let height = if is_grey {
            self.header.height as usize
        } else {
            0
        };
        self.data
            .chunks(self.header.stride.max(1) as usize)
            .take(height)
            .map_while(move |row| row.get(..width))
    }
}
