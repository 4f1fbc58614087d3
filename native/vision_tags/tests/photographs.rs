//! Compares the detector with the reference detector on real photographs.
//!
//! The photographs are not part of the repository. When their folder is absent, these tests
//! report it and pass.

#[path = "../../program/tests/support/shared_data.rs"]
mod shared_data;

use camera::photographs;
use ganglion_messages::frame::{Frame, FrameHeader};
use ganglion_messages::tags::TagDetection;
use shared_data::tags_folder;
use std::path::Path;
use vision_tags::detector::{Settings, TagDetector};

const TOLERANCE_PX: f64 = 0.2;

type Corners = [[f64; 2]; 4];

/// Reads lines of an id and four corners: `0, (277.9247 327.4884), (250.3570 329.7265), …`
fn truth(path: &Path) -> Vec<(i32, Corners)> {
    let text = std::fs::read_to_string(path).expect("the truth is readable");
    text.lines().map(truth_of_line).collect()
}

fn truth_of_line(line: &str) -> (i32, Corners) {
    let (id, rest) = line.split_once(',').expect("an id");
    let numbers: Vec<f64> = rest
        .split(|letter: char| "(), ".contains(letter))
        .filter(|part| !part.is_empty())
        .map(|part| part.parse().expect("a coordinate"))
        .collect();
    let corners: Vec<[f64; 2]> = numbers.chunks_exact(2).map(|xy| [xy[0], xy[1]]).collect();
    (
        id.parse().expect("a number"),
        corners.try_into().expect("four corners"),
    )
}

fn detections(path: &Path) -> Vec<TagDetection> {
    let photograph = photographs::read(path).expect("the photograph is readable");
    let header = FrameHeader::grey(photograph.width, photograph.height, 0, 0);
    let message = [&header.encode()[..], &photograph.pixels].concat();
    let frame = Frame::decode(&message).expect("a frame");
    TagDetector::new(Settings::default())
        .detect(&frame)
        .expect("a grey frame")
}

/// Returns the largest distance between corresponding corners.
fn deviation(one: &Corners, other: &Corners) -> f64 {
    let distances = one
        .iter()
        .zip(other)
        .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
    distances.fold(0.0, f64::max)
}

fn compare(name: &str, count: usize) {
    let Some(folder) = tags_folder() else { return };
    let truth = truth(&folder.join(name).with_extension("txt"));
    assert_eq!(truth.len(), count);
    let found = detections(&folder.join(name).with_extension("jpg"));
    for (id, corners) in &truth {
        let nearest = found
            .iter()
            .filter(|tag| tag.id == *id)
            .map(|tag| deviation(&tag.corners, corners))
            .fold(f64::MAX, f64::min);
        assert!(
            nearest <= TOLERANCE_PX,
            "{name}: tag {id} at {corners:?} is {nearest} px off"
        );
    }
    assert_eq!(found.len(), count);
}

#[test]
fn all_12_tags_of_the_first_photograph_are_found_where_the_reference_found_them() {
    compare("swarmathon_1", 12);
}

#[test]
fn all_10_tags_of_the_second_photograph_are_found_where_the_reference_found_them() {
    compare("swarmathon_2", 10);
}
