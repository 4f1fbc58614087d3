//! The detector: grey frames in, tags out.

use apriltag::{Detection, Detector, Family, Image};
use ganglion_messages::frame::{Frame, GREY};
use ganglion_messages::tags::TagDetection;
use std::fmt;

/// The tag families that can be looked for.
pub const FAMILIES: [&str; 3] = ["tag36h11", "tag25h9", "tag16h5"];

/// Decimations that the library knows how to undo.
pub const DECIMATIONS: [f32; 9] = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];

/// How many wrong bits of a tag are corrected.
const CORRECTED_BITS: usize = 2;

/// The shortest side, after decimation, that the detector is given. In less no tag can be told.
const SHORTEST_SIDE: u32 = 16;

/// The longest side that the detector's numbers can count.
const LONGEST_SIDE: u32 = 32_767;

/// The most pixels, rows' gaps included, that the detector's numbers can count.
const MOST_PIXELS: u64 = i32::MAX as u64 / 4;

/// How to look.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The family, one of [`FAMILIES`].
    pub family: &'static str,
    /// Threads that share the work.
    pub threads: u8,
    /// Look for tags in an image so many times smaller, one of [`DECIMATIONS`]: faster, and small tags are lost.
    pub quad_decimate: f32,
    /// Snap the edges to strong gradients nearby.
    pub refine_edges: bool,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            family: FAMILIES[0],
            threads: 1,
            quad_decimate: 1.0,
            refine_edges: false,
        }
    }
}

/// Why a frame cannot be looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LookError {
    /// Its pixels are not 8-bit grey but this format (V4L2's code).
    NotGrey(u32),
    /// It is larger than the detector can count.
    TooLarge {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
}

impl fmt::Display for LookError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LookError::NotGrey(fourcc) => {
                let name = fourcc.to_le_bytes().escape_ascii().to_string();
                write!(f, "the frame's pixels are {name}, not GREY")
            }
            LookError::TooLarge { width, height } => {
                write!(f, "a frame of {width}x{height} pixels is too large")
            }
        }
    }
}

impl std::error::Error for LookError {}

/// A detector, and the image that it looks at, which is used again while the size stays the same.
pub struct Eye {
    detector: Detector,
    image: Option<Image>,
    settings: Settings,
}

impl Eye {
    /// Makes a detector; its family's table of codes takes a moment.
    ///
    /// # Panics
    /// When the family is not one of [`FAMILIES`], or memory is out.
    pub fn new(settings: Settings) -> Eye {
        let family: Family = settings.family.parse().expect("a family of FAMILIES");
        let builder = Detector::builder().add_family_bits(family, CORRECTED_BITS);
        let mut detector = builder.build().expect("memory for a detector");
        detector.set_thread_number(settings.threads.max(1));
        detector.set_decimation(settings.quad_decimate);
        detector.set_refine_edges(settings.refine_edges);
        Eye {
            detector,
            image: None,
            settings,
        }
    }

    /// The tags in a frame, in the detector's order. A frame too small for any tag has none.
    pub fn look(&mut self, frame: &Frame<'_>) -> Result<Vec<TagDetection>, LookError> {
        let (width, height) = (frame.header.width, frame.header.height);
        if frame.header.fourcc != GREY {
            return Err(LookError::NotGrey(frame.header.fourcc));
        }
        if is_too_large(width, height) {
            return Err(LookError::TooLarge { width, height });
        }
        if self.is_too_small(width.min(height)) {
            return Ok(Vec::new());
        }
        let image = fitting(self.image.take(), width as usize, height as usize);
        let image = self.image.insert(copied(frame, image));
        let found = self.detector.detect(image);
        Ok(found.iter().map(|tag| self.settings.report(tag)).collect())
    }

    fn is_too_small(&self, side: u32) -> bool {
        side as f32 / self.settings.quad_decimate.max(1.0) < SHORTEST_SIDE as f32
    }
}

fn is_too_large(width: u32, height: u32) -> bool {
    width.max(height) > LONGEST_SIDE || u64::from(width) * u64::from(height) > MOST_PIXELS
}

/// The image used before if it has the right size, a new one otherwise.
fn fitting(used: Option<Image>, width: usize, height: usize) -> Image {
    used.filter(|image| (image.width(), image.height()) == (width, height))
        .unwrap_or_else(|| {
            let alignment = apriltag::image_buf::DEFAULT_ALIGNMENT_U8;
            Image::zeros_with_alignment(width, height, alignment).expect("memory for an image")
        })
}

/// The rows of a frame and of an image lie differently far apart.
fn copied(frame: &Frame<'_>, mut image: Image) -> Image {
    let stride = image.stride();
    for (to, from) in image.as_mut().chunks_mut(stride).zip(frame.rows()) {
        to[..from.len()].copy_from_slice(from);
    }
    image
}

impl Settings {
    fn report(&self, found: &Detection) -> TagDetection {
        let mut homography = [0.0; 9];
        homography.copy_from_slice(found.homography().data());
        TagDetection {
            family: self.family.to_owned(),
            id: found.id() as i32,
            hamming: found.hamming() as i32,
            goodness: 0.0,
            decision_margin: found.decision_margin(),
            centre: found.center(),
            corners: found.corners(),
            homography,
        }
    }
}
