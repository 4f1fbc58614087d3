//! The detector: finds AprilTags in grey frames.

use apriltag::{Detection, Detector, Family, Image};
use ganglion_messages::frame::{Frame, GREY};
use ganglion_messages::tags::TagDetection;
use std::fmt;

/// The tag families that the detector can find.
pub const FAMILIES: [&str; 3] = ["tag36h11", "tag25h9", "tag16h5"];

/// The decimations that the library can reverse.
pub const DECIMATIONS: [f32; 9] = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];

/// The most wrong bits of a tag that the detector corrects.
const CORRECTED_BITS: usize = 2;

/// The shortest side after decimation that the detector accepts. A smaller image cannot show a
/// tag.
const SHORTEST_SIDE: u32 = 16;

/// The longest side that fits the detector's integers.
const LONGEST_SIDE: u32 = 32_767;

/// The most pixels, padding included, that fit the detector's integers.
const MOST_PIXELS: u64 = i32::MAX as u64 / 4;

/// The detector's settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The tag family, one of [`FAMILIES`].
    pub family: &'static str,
    /// Number of threads.
    pub threads: u8,
    /// Factor by which the image is reduced first, one of [`DECIMATIONS`]. A higher one is faster
    /// and misses small tags.
    pub quad_decimate: f32,
    /// Whether edges are aligned with strong gradients nearby.
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

/// The reason why the detector rejects a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DetectError {
    /// The pixels are not 8-bit grey but have this format (V4L2's code).
    NotGrey(u32),
    /// The frame is too large for the detector's integers.
    TooLarge {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
}

impl fmt::Display for DetectError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            DetectError::NotGrey(fourcc) => {
                let name = fourcc.to_le_bytes().escape_ascii().to_string();
                write!(f, "expected a frame in pixel format GREY, got: {name}")
            }
            DetectError::TooLarge { width, height } => {
                write!(f, "frame of {width}x{height} pixels is too large")
            }
        }
    }
}

impl std::error::Error for DetectError {}

/// A detector with its image buffer, which is reused while the frame size stays the same.
pub struct TagDetector {
    detector: Detector,
    image: Option<Image>,
    settings: Settings,
}

impl TagDetector {
    /// Creates a detector and computes its family's table of codes.
    ///
    /// # Panics
    /// When the family is not one of [`FAMILIES`], or when memory is exhausted.
    pub fn new(settings: Settings) -> TagDetector {
        let family: Family = settings.family.parse().expect("a family of FAMILIES");
        let builder = Detector::builder().add_family_bits(family, CORRECTED_BITS);
        let mut detector = builder.build().expect("memory for a detector");
        detector.set_thread_number(settings.threads.max(1));
        detector.set_decimation(settings.quad_decimate);
        detector.set_refine_edges(settings.refine_edges);
        TagDetector {
            detector,
            image: None,
            settings,
        }
    }

    /// Returns the tags in a frame, in the library's order. A frame that is too small for a tag
    /// has none.
    ///
    /// # Errors
    /// A [`DetectError`] when the frame is not grey or too large.
    pub fn detect(&mut self, frame: &Frame<'_>) -> Result<Vec<TagDetection>, DetectError> {
        let (width, height) = (frame.header.width, frame.header.height);
        if frame.header.fourcc != GREY {
            return Err(DetectError::NotGrey(frame.header.fourcc));
        }
        if is_too_large(width, height) {
            return Err(DetectError::TooLarge { width, height });
        }
        if self.is_too_small(width.min(height)) {
            return Ok(Vec::new());
        }
        let image = image_of_size(self.image.take(), width as usize, height as usize);
        let image = self.image.insert(copy_rows(frame, image));
        let found = self.detector.detect(image);
        Ok(found.iter().map(|tag| self.settings.convert(tag)).collect())
    }

    fn is_too_small(&self, side: u32) -> bool {
        side as f32 / self.settings.quad_decimate.max(1.0) < SHORTEST_SIDE as f32
    }
}

fn is_too_large(width: u32, height: u32) -> bool {
    width.max(height) > LONGEST_SIDE || u64::from(width) * u64::from(height) > MOST_PIXELS
}

/// Returns the previous image if it has this size, or a new one.
fn image_of_size(previous: Option<Image>, width: usize, height: usize) -> Image {
    previous
        .filter(|image| (image.width(), image.height()) == (width, height))
        .unwrap_or_else(|| {
            let alignment = apriltag::image_buf::DEFAULT_ALIGNMENT_U8;
            Image::zeros_with_alignment(width, height, alignment).expect("memory for an image")
        })
}

/// Copies the frame row by row, because frame and image have different strides.
fn copy_rows(frame: &Frame<'_>, mut image: Image) -> Image {
    let stride = image.stride();
    for (to, from) in image.as_mut().chunks_mut(stride).zip(frame.rows()) {
        to[..from.len()].copy_from_slice(from);
    }
    image
}

impl Settings {
    fn convert(&self, found: &Detection) -> TagDetection {
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
