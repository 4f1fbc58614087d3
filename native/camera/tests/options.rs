//! The camera's command line and its usage errors.

use camera::options::{Call, HELP, Options, Picture};
use program::Failure;

fn options(arguments: &[&str]) -> Options {
    match Call::parse(arguments) {
        Ok(Call::Run(options)) => options,
        other => panic!("{arguments:?}: {other:?}"),
    }
}

fn refusal(arguments: &[&str]) -> String {
    match Call::parse(arguments) {
        Err(Failure::Usage(text)) => text,
        other => panic!("{arguments:?}: {other:?}"),
    }
}

#[test]
fn a_topic_is_enough() {
    let options = options(&["--topic", "camera"]);
    assert_eq!(options.topic.name(), "camera");
    assert_eq!((options.rate_hz, options.slots), (30.0, 4));
    let scene = Picture::Scene {
        width: 640,
        height: 480,
    };
    assert_eq!(options.picture, scene);
    assert!(!options.exit_with_stdin);
}

#[test]
fn everything_can_be_set() {
    let options = options(&[
        "--topic=c",
        "--rate=12.5",
        "--width=800",
        "--height=600",
        "--slots=8",
        "--exit-with-stdin",
    ]);
    assert_eq!((options.rate_hz, options.slots), (12.5, 8));
    let scene = Picture::Scene {
        width: 800,
        height: 600,
    };
    assert_eq!(options.picture, scene);
    assert!(options.exit_with_stdin);
}

#[test]
fn photographs_take_the_place_of_the_scene() {
    let options = options(&["--topic", "c", "--frames", "some/folder"]);
    assert_eq!(options.picture, Picture::Photographs("some/folder".into()));
}

#[test]
fn the_error_for_a_value_out_of_range_names_the_range() {
    for (option, value, expected) in [
        ("--rate", "0", "0.01 to 1000"),
        ("--rate", "-1", "0.01 to 1000"),
        ("--rate", "inf", "0.01 to 1000"),
        ("--rate", "nan", "0.01 to 1000"),
        ("--width", "319", "320 to 7680"),
        ("--height", "4321", "240 to 4320"),
        ("--slots", "3", "power of two from 2 to 64"),
        ("--slots", "1", "power of two from 2 to 64"),
        ("--topic", "a/b", "1 to 200 characters of A-Z"),
        ("--topic", "", "1 to 200 characters of A-Z"),
    ] {
        let text = refusal(&["--topic", "c", option, value]);
        let start = format!("invalid value for {option} option: expected ");
        let end = format!("got: {value:?}");
        assert!(
            text.starts_with(&start) && text.contains(expected) && text.ends_with(&end),
            "{text}"
        );
    }
}

#[test]
fn a_call_without_a_topic_is_refused() {
    assert!(refusal(&[]).starts_with("--topic option is missing"));
}

#[test]
fn photographs_with_a_size_are_refused() {
    let text = refusal(&["--topic", "c", "--frames", "d", "--width", "640"]);
    assert!(
        text.contains("--frames") && text.contains("--width"),
        "{text}"
    );
}

#[test]
fn help_lists_every_option() {
    for help in ["-h", "--help"] {
        assert_eq!(Call::parse([help]), Ok(Call::Help));
    }
    for version in ["-V", "--version"] {
        assert_eq!(Call::parse([version]), Ok(Call::Version));
    }
    let unknown = refusal(&["--nonsense"]);
    let (_, known) = unknown
        .split_once("expected one of: ")
        .expect("the known options");
    for option in known.split(' ') {
        let listed = |before: &str| HELP.contains(&format!("{before}{option}"));
        assert!(listed("  ") || listed(", "), "{option}");
    }
}
