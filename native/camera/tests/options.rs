//! How the camera is called, and what it says to a wrong call.

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
fn values_out_of_range_are_refused_with_the_range() {
    for (option, value, accepted) in [
        ("--rate", "0", "0.01 to 1000"),
        ("--rate", "-1", "0.01 to 1000"),
        ("--rate", "inf", "0.01 to 1000"),
        ("--rate", "nan", "0.01 to 1000"),
        ("--width", "319", "320 to 7680"),
        ("--height", "4321", "240 to 4320"),
        ("--slots", "3", "power of two from 2 to 64"),
        ("--slots", "1", "power of two from 2 to 64"),
        ("--topic", "a/b", "1 to 200 of A-Z"),
        ("--topic", "", "1 to 200 of A-Z"),
    ] {
        let text = refusal(&["--topic", "c", option, value]);
        let start = format!("{option} was given {value:?}; accepted: ");
        assert!(
            text.starts_with(&start) && text.contains(accepted),
            "{text}"
        );
    }
}

#[test]
fn a_call_without_a_topic_is_refused() {
    assert!(refusal(&[]).starts_with("--topic is missing"));
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
fn help_tells_of_every_option() {
    for help in ["-h", "--help"] {
        assert_eq!(Call::parse([help]), Ok(Call::Help));
    }
    for version in ["-V", "--version"] {
        assert_eq!(Call::parse([version]), Ok(Call::Version));
    }
    let unknown = refusal(&["--nonsense"]);
    let (_, accepted) = unknown.split_once("accepted: ").expect("what is accepted");
    for option in accepted.split(' ') {
        let stands = |before: &str| HELP.contains(&format!("{before}{option}"));
        assert!(stands("  ") || stands(", "), "{option}");
    }
}
