//! The bit patterns of the tag36h11 family, as the AprilTag library draws them.

use apriltag_sys as sys;

/// Cells along a side of the pattern: six of data, the black border, a white margin.
pub const CELLS: usize = 10;

/// Cells along a side of the black border, whose corners a detector reports.
pub const BORDER_CELLS: usize = 8;

/// The pattern of one tag: whether each cell is white, row by row from the top.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    white: [[bool; CELLS]; CELLS],
}

impl Pattern {
    /// Returns the tag36h11 with number `id`, or `None` when the family has no such tag.
    pub fn tag36h11(id: u32) -> Option<Pattern> {
        let family = Family::tag36h11();
        (id < family.count()).then(|| family.draw(id))
    }

    /// Returns whether the cell in this row and column is white. All cells outside the pattern
    /// are.
    pub fn is_white(&self, row: i32, column: i32) -> bool {
        let row = usize::try_from(row)
            .ok()
            .and_then(|row| self.white.get(row));
        let cell = row.and_then(|row| row.get(usize::try_from(column).ok()?));
        cell.copied().unwrap_or(true)
    }
}

/// The library's tag family, destroyed on drop.
struct Family(*mut sys::apriltag_family_t);

impl Family {
    fn tag36h11() -> Family {
        // SAFETY: the function has no precondition; it returns a family that we own.
        let family = unsafe { sys::tag36h11_create() };
        assert!(!family.is_null(), "out of memory");
        Family(family)
    }

    fn count(&self) -> u32 {
        // SAFETY: the pointer came from `tag36h11_create`, and only `drop` destroys it.
        unsafe { (*self.0).ncodes }
    }

    fn draw(&self, id: u32) -> Pattern {
        // SAFETY: the family is alive, and the caller has checked `id` against `count`.
        let image = unsafe { sys::apriltag_to_image(self.0, id as i32) };
        let pattern = read(image);
        // SAFETY: `apriltag_to_image` passed ownership of the image, which is not destroyed yet.
        unsafe { sys::image_u8_destroy(image) };
        pattern
    }
}

impl Drop for Family {
    fn drop(&mut self) {
        // SAFETY: the pointer came from `tag36h11_create` and is destroyed only here.
        unsafe { sys::tag36h11_destroy(self.0) };
    }
}

fn read(image: *const sys::image_u8_t) -> Pattern {
    // SAFETY: `image` came from `apriltag_to_image`; it is alive and nothing writes to it.
    let image = unsafe { &*image };
    let (width, height, stride) = (
        image.width as usize,
        image.height as usize,
        image.stride as usize,
    );
    assert_eq!(
        (width, height),
        (CELLS, CELLS),
        "a tag36h11 has 10 × 10 cells"
    );
    // SAFETY: the library allocates `height` rows of `stride` bytes at `buf`.
    let pixels = unsafe { std::slice::from_raw_parts(image.buf, height * stride) };
    let mut white = [[false; CELLS]; CELLS];
    for (cells, row) in white.iter_mut().zip(pixels.chunks(stride)) {
        for (cell, &grey) in cells.iter_mut().zip(row) {
            *cell = grey == 255;
        }
    }
    Pattern { white }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pattern_is_white_outside_black_at_its_border_and_mixed_within() {
        let pattern = Pattern::tag36h11(0).unwrap();
        for at in 0..CELLS as i32 {
            assert!(pattern.is_white(0, at) && pattern.is_white(at, 9));
        }
        for at in 1..=BORDER_CELLS as i32 {
            assert!(!pattern.is_white(1, at) && !pattern.is_white(at, 8));
        }
        let data = (2..8).flat_map(|row| (2..8).map(move |column| (row, column)));
        let white = data
            .filter(|&(row, column)| pattern.is_white(row, column))
            .count();
        assert!((6..30).contains(&white), "{white} white cells");
    }

    #[test]
    fn beyond_a_pattern_all_is_white() {
        let pattern = Pattern::tag36h11(0).unwrap();
        assert!(pattern.is_white(-1, 5) && pattern.is_white(5, 10));
    }

    #[test]
    fn the_family_has_587_tags_and_no_two_are_alike() {
        let all: Vec<_> = (0..587).map(|id| Pattern::tag36h11(id).unwrap()).collect();
        assert!(Pattern::tag36h11(587).is_none());
        assert!((1..all.len()).all(|i| !all[..i].contains(&all[i])));
    }
}
