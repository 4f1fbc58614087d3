//! A rendered scene: four tag36h11 cards that move, turn, tilt and change their size before a
//! textured wall.
//!
//! All functions are pure. The frame's number and its time determine the picture and the ground
//! truth ([`Scene::tags_at`]) that detections can be compared with. The cards are projected
//! through a pinhole. Each pixel is the mean of the area that it covers, so that edges are exact
//! to a fraction of a pixel.
//!
//! Pixel coordinates are the detector's: the upper left corner of the image is (0, 0) and the
//! centre of its first pixel (0.5, 0.5).

use crate::tag::{BORDER_CELLS, Pattern};
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// The scene's tags by their number in the family.
pub const TAG_IDS: [u32; 4] = [3, 42, 117, 586];

/// Widths that can be rendered, pixels.
pub const WIDTHS: RangeInclusive<u32> = 320..=7680;

/// Heights that can be rendered, pixels.
pub const HEIGHTS: RangeInclusive<u32> = 240..=4320;

const WHITE: u8 = 225;
const BLACK: u8 = 30;

/// Half of a card's side, in units of half of the black border's side.
const CARD: f64 = 1.5;

/// Cells per unit of length.
const HALF_BORDER: f64 = BORDER_CELLS as f64 / 2.0;

/// The pattern's index of the cell at the card's edge; the border's first cell has index 1.
const FIRST_CELL: i32 = 1 - ((CARD - 1.0) * HALF_BORDER) as i32;

/// Samples along a pixel's side, for a pixel that covers more than one cell.
const SAMPLES: u32 = 4;

const NOISE_LENGTH: usize = 1 << 16;

/// A tag and its place in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedTag {
    /// The tag's number in its family.
    pub id: u32,
    /// Centre, pixels.
    pub centre: [f64; 2],
    /// Corners of the black border in the detector's order: lower left, lower right, upper right,
    /// upper left for an upright tag.
    pub corners: [[f64; 2]; 4],
    /// Maps the tag's plane, with the border's corners at ±1 and y down, to pixels; row-major.
    pub homography: [f64; 9],
}

/// A scene of one size.
#[derive(Debug, Clone)]
pub struct Scene {
    width: u32,
    height: u32,
    wall: Vec<u8>,
    noise: Vec<i8>,
    patterns: [Pattern; TAG_IDS.len()],
}

impl Scene {
    /// Prepares a scene of this size.
    ///
    /// # Panics
    /// When the size is outside [`WIDTHS`] and [`HEIGHTS`].
    pub fn new(width: u32, height: u32) -> Scene {
        assert!(
            WIDTHS.contains(&width) && HEIGHTS.contains(&height),
            "expected a scene size within {WIDTHS:?} by {HEIGHTS:?} pixels, got: {width}x{height}"
        );
        Scene {
            width,
            height,
            wall: wall(width, height),
            noise: noise(),
            patterns: TAG_IDS.map(|id| Pattern::tag36h11(id).expect("a tag of the family")),
        }
    }

    /// Pixels in a row.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Returns the ground truth: the places of the tags at a time in seconds.
    pub fn tags_at(&self, seconds: f64) -> [PlacedTag; TAG_IDS.len()] {
        std::array::from_fn(|index| self.placed(index, seconds))
    }

    fn placed(&self, index: usize, seconds: f64) -> PlacedTag {
        let homography = pose(index, seconds).homography(self.width, self.height, index);
        let project = |x, y| project(&homography, x, y);
        PlacedTag {
            id: TAG_IDS[index],
            centre: project(0.0, 0.0),
            corners: [
                project(-1.0, 1.0),
                project(1.0, 1.0),
                project(1.0, -1.0),
                project(-1.0, -1.0),
            ],
            homography,
        }
    }

    /// Renders frame number `frame`, which shows the scene at `seconds`, into `pixels`, without
    /// padding between rows.
    ///
    /// # Panics
    /// When `pixels` is not width × height bytes long.
    pub fn render(&self, frame: u64, seconds: f64, pixels: &mut [u8]) {
        pixels.copy_from_slice(&self.wall);
        for (tag, pattern) in self.tags_at(seconds).iter().zip(&self.patterns) {
            self.draw(tag, pattern, pixels);
        }
        self.add_noise(frame, pixels);
    }

    /// Draws a card row by row. The cells at a row's upper corners are those at the lower corners
    /// of the previous row, and are computed once.
    fn draw(&self, tag: &PlacedTag, pattern: &Pattern, pixels: &mut [u8]) {
        let to_tag = inverse(&tag.homography);
        let (columns, rows) = self.bounds(tag);
        let corners = |y: u32| cells_along(&to_tag, columns.start, columns.end, y);
        let mut above = corners(rows.start);
        for y in rows {
            let below = corners(y + 1);
            let start = (y * self.width + columns.start) as usize;
            for (index, x) in columns.clone().enumerate() {
                let behind = pixels[start + index];
                let around = [
                    above[index],
                    above[index + 1],
                    below[index],
                    below[index + 1],
                ];
                pixels[start + index] = match uniform(around) {
                    Some(cell) => grey_of(cell, pattern, behind),
                    None => mean(&to_tag, pattern, x, y, behind),
                };
            }
            above = below;
        }
    }

    /// Returns the columns and rows that the card may touch.
    fn bounds(&self, tag: &PlacedTag) -> (std::ops::Range<u32>, std::ops::Range<u32>) {
        let ends = [(-CARD, -CARD), (-CARD, CARD), (CARD, -CARD), (CARD, CARD)]
            .map(|(x, y)| project(&tag.homography, x, y));
        let range = |axis: usize, limit: u32| {
            let least = ends.iter().map(|end| end[axis]).fold(f64::MAX, f64::min);
            let most = ends.iter().map(|end| end[axis]).fold(f64::MIN, f64::max);
            (least.floor().max(0.0) as u32)..(most.ceil().max(0.0) as u32).min(limit)
        };
        (range(0, self.width), range(1, self.height))
    }

    fn add_noise(&self, frame: u64, pixels: &mut [u8]) {
        let width = self.width as usize;
        for (y, row) in pixels.chunks_mut(width).enumerate() {
            let start = hash(frame << 16 ^ y as u64) as usize % (NOISE_LENGTH - width);
            for (pixel, &noise) in row.iter_mut().zip(&self.noise[start..]) {
                *pixel = pixel.saturating_add_signed(noise);
            }
        }
    }
}

/// The pose of a card.
struct Pose {
    /// The centre within the card's quarter of the image, -1..1.
    place: [f64; 2],
    /// Size relative to the largest.
    scale: f64,
    /// Rotation in the image plane, radians.
    roll: f64,
    /// Rotation about the card's vertical and horizontal axes, radians.
    tilt: [f64; 2],
}

/// Returns the pose of a card. Each card moves in its own quarter of the image, so that none
/// covers another.
fn pose(index: usize, seconds: f64) -> Pose {
    let phase = index as f64 * 1.7;
    let wave = |period: f64, shift: f64| (TAU * seconds / period + phase + shift).sin();
    let roll = match index {
        0 => TAU * seconds / 12.0,
        _ => 0.3 * wave(7.0 + index as f64, 0.4) + 0.45,
    };
    Pose {
        place: [wave(6.1, 0.0), wave(4.3, 1.1)],
        scale: 0.875 + 0.125 * wave(5.3, 2.0),
        roll,
        tilt: [0.45 * wave(8.9, 0.7), 0.35 * wave(7.7, 2.9)],
    }
}

impl Pose {
    /// Returns the pinhole projection of the card: columns of rotation and translation, in
    /// pixels.
    fn homography(&self, width: u32, height: u32, index: usize) -> [f64; 9] {
        let (width, height) = (f64::from(width), f64::from(height));
        let quarter = (width / 2.0).min(height / 2.0);
        let half_side = 0.185 * quarter * self.scale;
        let focal = 0.6 * width.max(height);
        let [across, down] = self.axes();

        let column = (index % 2) as f64 * 2.0 - 1.0;
        let row = (index / 2) as f64 * 2.0 - 1.0;
        let x = column * width / 4.0 + 0.09 * quarter * self.place[0];
        let y = row * height / 4.0 + 0.09 * quarter * self.place[1];

        let along = |axis: [f64; 3]| axis.map(|part| part * half_side / focal);
        let (across, down) = (along(across), along(down));
        let row_x = |part: [f64; 3]| focal * part[0] + width / 2.0 * part[2];
        let row_y = |part: [f64; 3]| focal * part[1] + height / 2.0 * part[2];
        let centre = [x / focal, y / focal, 1.0];
        [
            row_x(across),
            row_x(down),
            row_x(centre),
            row_y(across),
            row_y(down),
            row_y(centre),
            across[2],
            down[2],
            centre[2],
        ]
    }

    /// Returns the directions of the card's right and lower edges in camera coordinates (x right,
    /// y down, z ahead).
    fn axes(&self) -> [[f64; 3]; 2] {
        let (roll_sin, roll_cos) = self.roll.sin_cos();
        let tilted = |[x, y]: [f64; 2]| {
            let (yaw_sin, yaw_cos) = self.tilt[0].sin_cos();
            let (pitch_sin, pitch_cos) = self.tilt[1].sin_cos();
            [
                x * yaw_cos + y * yaw_sin * pitch_sin,
                y * pitch_cos,
                y * yaw_cos * pitch_sin - x * yaw_sin,
            ]
        };
        [tilted([roll_cos, roll_sin]), tilted([-roll_sin, roll_cos])]
    }
}

fn project(homography: &[f64; 9], x: f64, y: f64) -> [f64; 2] {
    let h = homography;
    let scale = h[6] * x + h[7] * y + h[8];
    [
        (h[0] * x + h[1] * y + h[2]) / scale,
        (h[3] * x + h[4] * y + h[5]) / scale,
    ]
}

/// Returns the adjugate, the inverse up to a factor that projection does not need.
fn inverse(h: &[f64; 9]) -> [f64; 9] {
    let minor = |a: usize, b: usize, c: usize, d: usize| h[a] * h[d] - h[b] * h[c];
    [
        minor(4, 5, 7, 8),
        -minor(1, 2, 7, 8),
        minor(1, 2, 4, 5),
        -minor(3, 5, 6, 8),
        minor(0, 2, 6, 8),
        -minor(0, 2, 3, 5),
        minor(3, 4, 6, 7),
        -minor(0, 1, 6, 7),
        minor(0, 1, 3, 4),
    ]
}

/// A cell of the card's grid, or `None` outside the card.
type Cell = Option<(i32, i32)>;

fn cell_at(to_tag: &[f64; 9], x: f64, y: f64) -> Cell {
    let [u, v] = project(to_tag, x, y);
    let inside = u.abs() <= CARD && v.abs() <= CARD;
    // Relative to the card's edge no number is negative, so that a cast rounds down, faster than
    // `floor`.
    let cell = |part: f64| ((part + CARD) * HALF_BORDER) as i32 + FIRST_CELL;
    inside.then(|| (cell(v), cell(u)))
}

fn grey_of(cell: Cell, pattern: &Pattern, behind: u8) -> u8 {
    match cell {
        None => behind,
        Some((row, column)) if pattern.is_white(row, column) => WHITE,
        Some(_) => BLACK,
    }
}

/// Returns the cells at the left corners of the pixels `from..to` of a row, and at the right
/// corner of the last one.
fn cells_along(to_tag: &[f64; 9], from: u32, to: u32, y: u32) -> Vec<Cell> {
    (from..=to)
        .map(|x| cell_at(to_tag, f64::from(x), f64::from(y)))
        .collect()
}

/// Returns the common cell of a pixel's four corners. Cells and pixels are convex, so the whole
/// pixel lies in that cell. A corner of the card that ends within a pixel is not drawn.
fn uniform(corners: [Cell; 4]) -> Option<Cell> {
    let same = corners.iter().all(|&corner| corner == corners[0]);
    same.then_some(corners[0])
}

/// Returns the mean grey of the area that a pixel covers.
fn mean(to_tag: &[f64; 9], pattern: &Pattern, x: u32, y: u32, behind: u8) -> u8 {
    let at =
        |part: u32, step: u32| f64::from(part) + (f64::from(step) + 0.5) / f64::from(SAMPLES);
    let points = (0..SAMPLES).flat_map(|row| (0..SAMPLES).map(move |column| (column, row)));
    let sum: u32 = points
        .map(|(column, row)| cell_at(to_tag, at(x, column), at(y, row)))
        .map(|cell| u32::from(grey_of(cell, pattern, behind)))
        .sum();
    ((sum + SAMPLES * SAMPLES / 2) / (SAMPLES * SAMPLES)) as u8
}

/// Renders a plain wall with patches of rough plaster, so that parts of the picture give the
/// detector work.
fn wall(width: u32, height: u32) -> Vec<u8> {
    let grey = |x: u32, y: u32| {
        let patch = (4.0 * blotch(x, y, 150) - 0.4).clamp(0.0, 1.0);
        let plaster = 60.0 * blotch(x, y, 37) + 30.0 * blotch(x, y, 11);
        (115.0 + patch * plaster) as u8
    };
    (0..height)
        .flat_map(|y| (0..width).map(move |x| grey(x, y)))
        .collect()
}

/// Returns smooth noise, -0.5..0.5: interpolated random values on a grid of cells of `size`
/// pixels.
fn blotch(x: u32, y: u32, size: u32) -> f64 {
    let smooth = |part: u32| {
        let t = f64::from(part % size) / f64::from(size);
        t * t * (3.0 - 2.0 * t)
    };
    let (column, row) = (u64::from(x / size), u64::from(y / size));
    let value = |dx: u64, dy: u64| {
        let key = (column + dx) << 40 ^ (row + dy) << 16 ^ u64::from(size);
        (hash(key) >> 40) as f64 / (1u64 << 24) as f64 - 0.5
    };
    let across = |dy| lerp(value(0, dy), value(1, dy), smooth(x));
    lerp(across(0), across(1), smooth(y))
}

fn lerp(from: f64, to: f64, t: f64) -> f64 {
    from + (to - from) * t
}

/// Returns a sensor's noise: bell-shaped, mostly one grey level up or down.
fn noise() -> Vec<i8> {
    (0..NOISE_LENGTH as u64)
        .map(|index| {
            let bytes = hash(index ^ 0x6e6f_6973_6500_0000).to_le_bytes();
            let sum: i32 = bytes[..4].iter().map(|&byte| i32::from(byte) - 128).sum();
            (f64::from(sum) * 0.7 / 148.0).round() as i8
        })
        .collect()
}

/// SplitMix64's mixing function, the only source of randomness, the same at each start.
fn hash(key: u64) -> u64 {
    let mut z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
