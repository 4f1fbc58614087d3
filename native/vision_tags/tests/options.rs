//! The detector's command line and its usage errors.

use conduit_ring::Topic;
use program::Failure;
use vision_tags::detector::Settings;
use vision_tags::options::{Call, HELP, Options};

const TOPICS: [&str; 4] = ["--frames", "f", "--detections", "d"];

fn parse(more: &[&str]) -> Result<Call, Failure> {
    Call::parse([&TOPICS, more].concat())
}

fn options(more: &[&str]) -> Options {
    match parse(more) {
        Ok(Call::Run(options)) => options,
        other => panic!("{more:?}: {other:?}"),
    }
}

fn refusal<T: std::fmt::Debug>(result: Result<T, Failure>) -> String {
    match result {
        Err(Failure::Usage(text)) => text,
        other => panic!("{other:?}"),
    }
}

#[test]
fn two_topics_are_enough() {
    let options = options(&[]);
    assert_eq!(
        (options.frames.name(), options.detections.name()),
        ("f", "d")
    );
    assert_eq!(options.imu, None);
    assert_eq!(options.settings, Settings::default());
}

#[test]
fn a_topic_of_another_program_may_have_any_name() {
    let imu = options(&["--imu", "front:imu"]).imu;
    assert_eq!(imu, Topic::found("front:imu").ok());
}

#[test]
fn the_defaults_are_those_of_the_reference_detector() {
    let settings = Settings::default();
    assert_eq!(settings.family, "tag36h11");
    assert_eq!(settings.quad_decimate, 1.0);
    assert!(!settings.refine_edges);
}

#[test]
fn everything_can_be_set() {
    let options = options(&[
        "--imu=i",
        "--family=tag25h9",
        "--threads=2",
        "--quad-decimate=1.5",
        "--refine-edges",
        "--exit-with-stdin",
    ]);
    assert_eq!(options.imu, Topic::new("i").ok());
    let settings = Settings {
        family: "tag25h9",
        threads: 2,
        quad_decimate: 1.5,
        refine_edges: true,
    };
    assert_eq!(options.settings, settings);
    assert!(options.exit_with_stdin);
}

#[test]
fn the_error_for_an_invalid_value_says_what_was_expected() {
    for (option, value, expected) in [
        ("--family", "tag36h10", "tag36h11, tag25h9, tag16h5"),
        ("--threads", "0", "1 to 16"),
        ("--quad-decimate", "2.5", "1, 1.5, 2"),
        ("--quad-decimate", "0.5", "1, 1.5, 2"),
        ("--imu", "a/b", "1 to 200 characters of A-Z"),
        ("--detections", "a b", "1 to 200 characters of A-Z"),
    ] {
        let text = refusal(parse(&[option, value]));
        let start = format!("invalid value for {option} option: expected ");
        let end = format!("got: {value:?}");
        assert!(
            text.starts_with(&start) && text.contains(expected) && text.ends_with(&end),
            "{text}"
        );
    }
}

#[test]
fn topics_that_are_the_same_are_refused() {
    for clash in [["--detections", "f"], ["--imu", "f"], ["--imu", "d"]] {
        let text = refusal(parse(&clash));
        assert!(text.contains("three different topics"), "{text}");
    }
}

#[test]
fn the_error_for_a_missing_topic_names_the_option() {
    let text = refusal(Call::parse(["--frames", "f"]));
    assert!(text.starts_with("--detections option is missing"), "{text}");
    let text = refusal(Call::parse(["--detections", "d"]));
    assert!(text.starts_with("--frames option is missing"), "{text}");
}

#[test]
fn help_lists_every_option() {
    for help in ["-h", "--help"] {
        assert_eq!(parse(&[help]), Ok(Call::Help));
    }
    for version in ["-V", "--version"] {
        assert_eq!(parse(&[version]), Ok(Call::Version));
    }
    let unknown = refusal(parse(&["--nonsense"]));
    let (_, known) = unknown
        .split_once("expected one of: ")
        .expect("the known options");
    for option in known.split(' ') {
        let listed = |before: &str| HELP.contains(&format!("{before}{option}"));
        assert!(listed("  ") || listed(", "), "{option}");
    }
}
