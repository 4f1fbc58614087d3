//! Photographs of a folder as grey pictures.
//!
//! Of a JPEG it is the luma (Y) plane as it was stored, not a conversion of its colours: what comes back from colours is
//! rounded, and faint edges get lost. A picture that is stored in colours (PNG, rarely JPEG) is weighed as JPEG weighs.

use std::fmt;
use std::fs;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// The names' endings that count as photographs, in any case of letters.
pub const ENDINGS: [&str; 3] = ["jpg", "jpeg", "png"];

/// How many bytes the pictures of a folder may take in memory together.
pub const FOLDER_LIMIT: usize = 1 << 30;

const SIDE_LIMIT: usize = 16_384;

/// A grey picture, rows without a gap.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photograph {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Width × height bytes.
    pub pixels: Vec<u8>,
}

/// Why a folder or one of its files gives no picture.
#[derive(Debug)]
pub enum PhotographError {
    /// The folder or file cannot be read.
    Unreadable(PathBuf, io::Error),
    /// No file of the folder has one of the [`ENDINGS`].
    NoneIn(PathBuf),
    /// It was read and is no picture that we understand; why not, in the decoder's words.
    NotAPicture(PathBuf, String),
    /// With this file the folder's pictures exceed [`FOLDER_LIMIT`].
    TooMany(PathBuf),
}

impl fmt::Display for PhotographError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PhotographError::Unreadable(path, error) => {
                write!(f, "{} cannot be read: {error}", path.display())
            }
            PhotographError::NoneIn(path) => {
                write!(f, "{} has no .jpg, .jpeg or .png file", path.display())
            }
            PhotographError::NotAPicture(path, cause) => {
                write!(
                    f,
                    "{} is not a picture that can be read: {cause}",
                    path.display()
                )
            }
            PhotographError::TooMany(path) => write!(
                f,
                "with {} the folder's pictures take more than {} MiB",
                path.display(),
                FOLDER_LIMIT >> 20
            ),
        }
    }
}

impl std::error::Error for PhotographError {}

/// All photographs of a folder in the order of their names. Other files, hidden ones and subfolders are passed over; one
/// photograph that cannot be read is an error.
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

/// Reads one photograph. What it is, its first bytes say, not its name.
pub fn read(path: &Path) -> Result<Photograph, PhotographError> {
    let bytes =
        fs::read(path).map_err(|error| PhotographError::Unreadable(path.to_owned(), error))?;
    decode(&bytes).map_err(|cause| PhotographError::NotAPicture(path.to_owned(), one_line(&cause)))
}

/// Decoders speak in several lines at times.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn decode(bytes: &[u8]) -> Result<Photograph, String> {
    match bytes {
        [0xFF, 0xD8, ..] => decode_jpeg(bytes),
        [0x89, b'P', b'N', b'G', ..] => decode_png(bytes),
        [] => Err("it is empty".into()),
        _ => Err("it is neither JPEG nor PNG".into()),
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
    let info = decoder.info().ok_or("it has no size")?;
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
    decoder.input_colorspace().ok_or("it has no colours".into())
}

fn decode_png(bytes: &[u8]) -> Result<Photograph, String> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let size = reader.output_buffer_size().ok_or("it is too large")?;
    if size > FOLDER_LIMIT {
        return Err("it is too large".into());
    }
    let mut samples = vec![0; size];
    let info = reader
        .next_frame(&mut samples)
        .map_err(|error| error.to_string())?;
    let samples = &samples[..info.buffer_size()];
    photograph(info.width, info.height, samples, info.color_type.samples())
}

/// Makes the grey picture of samples that have so many channels: grey, grey and alpha, RGB, RGB and alpha.
fn photograph(
    width: u32,
    height: u32,
    samples: &[u8],
    channels: usize,
) -> Result<Photograph, String> {
    let pixels: Vec<u8> = samples.chunks_exact(channels).map(grey).collect();
    if pixels.len() as u64 != u64::from(width) * u64::from(height) {
        return Err("its pixels are not all there".into());
    }
    Ok(Photograph {
        width,
        height,
        pixels,
    })
}

/// JPEG's weights (ITU-R BT.601).
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
