//! Properties of the rendered scene that comparisons rely on.

use camera::scene::{PlacedTag, Scene, TAG_IDS};

const RATE: f64 = 30.0;

fn picture(scene: &Scene, number: u64) -> Vec<u8> {
    let mut pixels = vec![0; (scene.width() * scene.height()) as usize];
    scene.render(number, number as f64 / RATE, &mut pixels);
    pixels
}

fn moments() -> impl Iterator<Item = f64> {
    (0..4000).map(|step| f64::from(step) * 0.05)
}

fn corners(tags: &[PlacedTag]) -> impl Iterator<Item = [f64; 2]> {
    tags.iter().flat_map(|tag| tag.corners)
}

#[test]
fn a_frame_is_the_same_whenever_it_is_rendered() {
    let scene = Scene::new(320, 240);
    assert_eq!(picture(&scene, 77), picture(&Scene::new(320, 240), 77));
    assert_ne!(picture(&scene, 77), picture(&scene, 78));
}

#[test]
fn at_least_three_tags_with_different_numbers_are_in_the_scene() {
    let mut ids = TAG_IDS.to_vec();
    ids.sort();
    ids.dedup();
    assert!(ids.len() >= 3 && ids.len() == TAG_IDS.len());
}

#[test]
fn each_tag_stays_in_its_quarter_of_the_image_at_all_times() {
    for (width, height) in [(640, 480), (320, 240), (1280, 400), (400, 1280)] {
        let scene = Scene::new(width, height);
        let (middle_x, middle_y) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
        for seconds in moments() {
            for (index, tag) in scene.tags_at(seconds).iter().enumerate() {
                for [x, y] in tag.corners {
                    assert!(
                        (0.0..f64::from(width)).contains(&x)
                            && (0.0..f64::from(height)).contains(&y)
                    );
                    assert_eq!(
                        (x > middle_x, y > middle_y),
                        (index % 2 == 1, index / 2 == 1)
                    );
                }
            }
        }
    }
}

#[test]
fn tags_move_smoothly() {
    let scene = Scene::new(640, 480);
    let mut before = scene.tags_at(0.0);
    for step in 1..4000 {
        let now = scene.tags_at(f64::from(step) / RATE);
        for (from, to) in corners(&before).zip(corners(&now)) {
            assert!((from[0] - to[0]).hypot(from[1] - to[1]) < 4.0);
        }
        before = now;
    }
}

/// Returns how much a measure of each tag changes over time: the least of all tags.
fn least_spread(measure: impl Fn(&PlacedTag) -> f64) -> f64 {
    let scene = Scene::new(640, 480);
    let spread = |index: usize| {
        let values = moments().map(|seconds| measure(&scene.tags_at(seconds)[index]));
        let (least, most) = values.fold((f64::MAX, f64::MIN), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        most - least
    };
    (0..TAG_IDS.len()).map(spread).fold(f64::MAX, f64::min)
}

fn side(tag: &PlacedTag, index: usize) -> f64 {
    let (from, to) = (tag.corners[index], tag.corners[(index + 1) % 4]);
    (from[0] - to[0]).hypot(from[1] - to[1])
}

#[test]
fn every_tag_moves_turns_changes_its_size_and_is_seen_in_perspective() {
    assert!(least_spread(|tag| tag.centre[0]) > 20.0);
    assert!(least_spread(|tag| tag.centre[1]) > 20.0);
    assert!(
        least_spread(|tag| {
            let [from, to] = [tag.corners[0], tag.corners[1]];
            (to[1] - from[1]).atan2(to[0] - from[0])
        }) > 0.4
    );
    assert!(least_spread(|tag| side(tag, 0)) > 10.0);
    assert!(least_spread(|tag| side(tag, 0) / side(tag, 2)) > 0.02);
}

#[test]
fn pixels_inside_a_tags_corners_are_dark_and_outside_they_are_bright() {
    let scene = Scene::new(640, 480);
    let pixels = picture(&scene, 10);
    let grey = |[x, y]: [f64; 2]| pixels[y as usize * 640 + x as usize];
    for tag in scene.tags_at(10.0 / RATE) {
        let along = |corner: [f64; 2], part: f64| {
            [0, 1].map(|axis| tag.centre[axis] + (corner[axis] - tag.centre[axis]) * part)
        };
        for corner in tag.corners {
            assert!(grey(along(corner, 0.9)) < 60);
            assert!(grey(along(corner, 1.1)) > 200);
        }
    }
}

#[test]
#[should_panic(expected = "got: 100x100")]
fn the_panic_for_an_impossible_size_names_it() {
    Scene::new(100, 100);
}
