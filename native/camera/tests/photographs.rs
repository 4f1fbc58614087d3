//! Photographs from files: grey values, order, and errors for files that cannot be read.

#[path = "../../program/tests/support/shared_data.rs"]
mod shared_data;

use camera::photographs::{self, Photograph, PhotographError};
use shared_data::tags_folder;
use std::fs;
use std::path::{Path, PathBuf};

/// Creates a folder for one test.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn write_png(
    path: &Path,
    (width, height): (u32, u32),
    colour: png::ColorType,
    depth: png::BitDepth,
    data: &[u8],
) {
    let mut encoder = png::Encoder::new(fs::File::create(path).expect("a file"), width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(data).expect("pixels");
}

fn read_png(
    colour: png::ColorType,
    depth: png::BitDepth,
    size: (u32, u32),
    data: &[u8],
) -> Photograph {
    let path = folder(&format!("png_{colour:?}_{depth:?}")).join("a.png");
    write_png(&path, size, colour, depth, data);
    photographs::read(&path).expect("a picture")
}

fn write_grey(path: &Path, grey: u8) {
    write_png(
        path,
        (1, 1),
        png::ColorType::Grayscale,
        png::BitDepth::Eight,
        &[grey],
    );
}

#[test]
fn a_grey_png_is_taken_as_it_is() {
    let read = read_png(
        png::ColorType::Grayscale,
        png::BitDepth::Eight,
        (3, 2),
        &[0, 1, 2, 253, 254, 255],
    );
    assert_eq!((read.width, read.height), (3, 2));
    assert_eq!(read.pixels, [0, 1, 2, 253, 254, 255]);
}

#[test]
fn a_png_of_16_or_1_bits_becomes_one_of_8() {
    let deep = read_png(
        png::ColorType::Grayscale,
        png::BitDepth::Sixteen,
        (2, 1),
        &[0x12, 0x34, 0xFF, 0xFF],
    );
    assert_eq!(deep.pixels, [0x12, 0xFF]);
    let flat = read_png(
        png::ColorType::Grayscale,
        png::BitDepth::One,
        (4, 1),
        &[0b0101_0000],
    );
    assert_eq!(flat.pixels, [0, 255, 0, 255]);
}

#[test]
fn colours_are_converted_with_jpegs_weights_and_transparency_is_ignored() {
    let colours = [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255];
    let read = read_png(png::ColorType::Rgb, png::BitDepth::Eight, (4, 1), &colours);
    assert_eq!(read.pixels, [76, 150, 29, 255]);
    let read = read_png(
        png::ColorType::Rgba,
        png::BitDepth::Eight,
        (1, 1),
        &[0, 255, 0, 0],
    );
    assert_eq!(read.pixels, [150]);
    let read = read_png(
        png::ColorType::GrayscaleAlpha,
        png::BitDepth::Eight,
        (1, 1),
        &[9, 0],
    );
    assert_eq!(read.pixels, [9]);
}

#[test]
fn a_folder_is_read_in_the_order_of_names_and_other_files_are_skipped() {
    let folder = folder("order");
    write_grey(&folder.join("c.png"), 3);
    write_grey(&folder.join("a.PNG"), 1);
    write_grey(&folder.join("b.jpeg"), 2);
    write_grey(&folder.join(".hidden.png"), 9);
    fs::write(folder.join("a.txt"), "the truth").unwrap();
    fs::create_dir(folder.join("d.png")).unwrap();
    let greys: Vec<u8> = photographs::read_folder(&folder)
        .unwrap()
        .iter()
        .map(|one| one.pixels[0])
        .collect();
    assert_eq!(greys, [1, 2, 3]);
}

#[test]
fn the_error_for_a_missing_or_empty_folder_names_it() {
    let empty = folder("empty");
    let error = photographs::read_folder(&empty).unwrap_err();
    assert!(matches!(error, PhotographError::NoneIn(_)));
    assert!(error.to_string().contains(empty.to_str().unwrap()));

    let missing = empty.join("missing");
    let error = photographs::read_folder(&missing).unwrap_err();
    assert!(matches!(error, PhotographError::Unreadable(..)));
    assert!(error.to_string().contains(missing.to_str().unwrap()));
}

#[test]
fn a_file_instead_of_a_folder_is_an_error() {
    let file = folder("file").join("a.png");
    write_grey(&file, 1);
    let error = photographs::read_folder(&file).unwrap_err();
    assert!(error.to_string().contains("Not a directory"), "{error}");
}

#[test]
fn one_photograph_that_cannot_be_read_is_an_error_that_names_it() {
    let png = {
        let path = folder("whole").join("a.png");
        write_png(
            &path,
            (64, 64),
            png::ColorType::Grayscale,
            png::BitDepth::Eight,
            &[7; 4096],
        );
        fs::read(path).unwrap()
    };
    for (name, bytes) in [
        ("empty.png", &[][..]),
        ("text.jpg", b"not a picture"),
        ("short.jpg", &[0xFF, 0xD8, 0xFF, 0xE0]),
        ("cut.png", &png[..png.len() / 2]),
    ] {
        let folder = folder(name);
        write_grey(&folder.join("a.png"), 1);
        fs::write(folder.join(name), bytes).unwrap();
        let error = photographs::read_folder(&folder).unwrap_err();
        assert!(
            matches!(error, PhotographError::NotAPicture(..)),
            "{name}: {error}"
        );
        assert!(error.to_string().contains(name), "{error}");
        assert!(!error.to_string().contains('\n'), "{error}");
    }
}

#[test]
fn real_photographs_are_read_and_cut_ones_are_refused() {
    let Some(shared) = tags_folder() else { return };
    let all = photographs::read_folder(&shared).unwrap();
    assert_eq!(all.len(), 2);
    assert!(all.iter().all(|one| (one.width, one.height) == (799, 533)));

    let bytes = fs::read(shared.join("swarmathon_1.jpg")).unwrap();
    let cut = folder("cut_jpeg").join("cut.jpg");
    for length in [20, 1000, bytes.len() / 2, bytes.len() - 2000] {
        fs::write(&cut, &bytes[..length]).unwrap();
        assert!(photographs::read(&cut).is_err(), "{length} bytes");
    }
}
