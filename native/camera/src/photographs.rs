//! The photographs of a folder as grey pictures.
//!
//! The grey values of a JPEG are its stored luma (Y) plane. A conversion from its colours would
//! round them and lose faint edges. A picture that is stored in colours (PNG, rarely JPEG) is
//! converted with JPEG's weights.

use std::fmt;
use std::fs;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// The file name extensions of photographs, in lower or upper case.
pub const ENDINGS: [&str; 3] = ["jpg", "jpeg", "png"];

/// The most bytes that the decoded pictures of a folder may take in memory.
pub const FOLDER_LIMIT: usize = 1 << 30;

const SIDE_LIMIT: usize = 16_384;

/// A grey picture, without padding between rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photograph {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Width × height bytes.
    pub pixels: Vec<u8>,
}

/// The reason why a folder or one of its files gives no picture.
#[derive(Debug)]
pub enum PhotographError {
    /// The folder or file cannot be read.
    Unreadable(PathBuf, io::Error),
    /// No file of the folder has one of the [`ENDINGS`].
    NoneIn(PathBuf),
    /// The file was read but not decoded; the decoder's error.
    NotAPicture(PathBuf, String),
    /// This file makes the folder's pictures exceed [`FOLDER_LIMIT`].
    TooMany(PathBuf),
}

impl fmt::Display for PhotographError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PhotographError::Unreadable(path, error) => {
                write!(f, "could not read {}: {error}", path.display())
            }
            PhotographError::NoneIn(path) => {
                write!(
                    f,
                    "folder {} has no .jpg, .jpeg or .png file",
                    path.display()
                )
            }
            PhotographError::NotAPicture(path, cause) => {
                write!(f, "could not decode {}: {cause}", path.display())
            }
            PhotographError::TooMany(path) => write!(
                f,
                "cannot load {}: the folder's pictures take more than {} MiB",
                path.display(),
                FOLDER_LIMIT >> 20
            ),
        }
    }
}

impl std::error::Error for PhotographError {}

/// Reads all photographs of a folder in the order of their names. Skips other files, hidden files
/// and subfolders.
///
/// # Errors
/// A [`PhotographError`] when the folder or one of its photographs cannot be read, when it has
/// none, and when they exceed [`FOLDER_LIMIT`].
pub fn read_folder(folder: &Path) -> Result<Vec<Photograph>, PhotographError> {
    let mut bytes = 0;
    let mut photographs = Vec::new();
    for path in list(folder)? {
        let photograph = read(&path)?;
        bytes += photograph.pixels.len();
        if bytes > FOLDER_LIMIT {
            return Err(PhotographError::TooMany(path));
        }
        photographs.push(photograph);
    }
    if photographs.is_empty() {
        return Err(PhotographError::NoneIn(folder.to_owned()));
    }
    Ok(photographs)
}

fn list(folder: &Path) -> Result<Vec<PathBuf>, PhotographError> {
    let unreadable = |error| PhotographError::Unreadable(folder.to_owned(), error);
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if is_photograph(&path) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

fn is_photograph(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().as_encoded_bytes();
    let ending = path.extension().and_then(|ending| ending.to_str());
    let known =
        ending.is_some_and(|ending| ENDINGS.contains(&ending.to_ascii_lowercase().as_str()));
    known && !name.starts_with(b".") && !path.is_dir()
}

/// Reads one photograph. The first bytes of the file decide about its format, not its name.
///
/// # Errors
/// [`PhotographError::Unreadable`] and [`PhotographError::NotAPicture`].
pub fn read(path: &Path) -> Result<Photograph, PhotographError> {
    let bytes =
        fs::read(path).map_err(|error| PhotographError::Unreadable(path.to_owned(), error))?;
    decode(&bytes)
        .map_err(|cause| PhotographError::NotAPicture(path.to_owned(), one_line(&cause)))
}

/// Joins the lines of a decoder's message.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn decode(bytes: &[u8]) -> Result<Photograph, String> {
    match bytes {
        [0xFF, 0xD8, ..] => decode_jpeg(bytes),
        [0x89, b'P', b'N', b'G', ..] => decode_png(bytes),
        [] => Err("the file is empty".into()),
        _ => Err("the file is neither JPEG nor PNG".into()),
    }
}

fn decode_jpeg(bytes: &[u8]) -> Result<Photograph, String> {
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(SIDE_LIMIT)
        .set_max_height(SIDE_LIMIT);
    let has_luma = matches!(
        jpeg_colours(bytes, options)?,
        ColorSpace::YCbCr | ColorSpace::Luma
    );
    let (stored, channels) = if has_luma {
        (ColorSpace::Luma, 1)
    } else {
        (ColorSpace::RGB, 3)
    };
    let options = options.jpeg_set_out_colorspace(stored);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let samples = decoder.decode().map_err(|error| error.to_string())?;
    let info = decoder.info().ok_or("the file states no size")?;
    photograph(
        u32::from(info.width),
        u32::from(info.height),
        &samples,
        channels,
    )
}

fn jpeg_colours(bytes: &[u8], options: DecoderOptions) -> Result<ColorSpace, String> {
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder
        .decode_headers()
        .map_err(|error| error.to_string())?;
    decoder
        .input_colorspace()
        .ok_or("the file states no colour space".into())
}

fn decode_png(bytes: &[u8]) -> Result<Photograph, String> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let size = reader
        .output_buffer_size()
        .ok_or("the picture is too large")?;
    if size > FOLDER_LIMIT {
        return Err("the picture is too large".into());
    }
    let mut samples = vec![0; size];
    let info = reader
        .next_frame(&mut samples)
        .map_err(|error| error.to_string())?;
    let samples = &samples[..info.buffer_size()];
    photograph(info.width, info.height, samples, info.color_type.samples())
}

/// Converts samples with this number of channels (grey, grey and alpha, RGB, RGB and alpha) into
/// a grey picture.
fn photograph(
    width: u32,
    height: u32,
    samples: &[u8],
    channels: usize,
) -> Result<Photograph, String> {
    let pixels: Vec<u8> = samples.chunks_exact(channels).map(grey).collect();
    if pixels.len() as u64 != u64::from(width) * u64::from(height) {
        return Err("the file has too few pixels".into());
    }
    Ok(Photograph {
        width,
        height,
        pixels,
    })
}

/// Converts a pixel to grey with JPEG's weights (ITU-R BT.601).
fn grey(pixel: &[u8]) -> u8 {
    match *pixel {
        [red, green, blue, ..] => {
            let sum = 299 * u32::from(red) + 587 * u32::from(green) + 114 * u32::from(blue);
            ((sum + 500) / 1000) as u8
        }
        [grey, ..] => grey,
        [] => 0,
    }
}
