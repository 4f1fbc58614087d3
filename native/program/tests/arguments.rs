//! Reading of options and their error messages.

use program::Failure;
use program::arguments::{Argument, Arguments, required};

const KNOWN: &[&str] = &["--rate", "--verbose"];

fn usage<T: std::fmt::Debug>(result: Result<T, Failure>) -> String {
    match result {
        Err(Failure::Usage(text)) => text,
        other => panic!("expected a usage error, got {other:?}"),
    }
}

fn rate(arguments: &[&str]) -> Result<f64, Failure> {
    let mut arguments = Arguments::new(arguments, KNOWN);
    arguments.next()?;
    arguments.parse("1 to 9", |rate| (1.0..=9.0).contains(rate))
}

#[test]
fn a_value_follows_its_option_or_an_equals_sign() {
    assert_eq!(rate(&["--rate", "2.5"]), Ok(2.5));
    assert_eq!(rate(&["--rate=2.5"]), Ok(2.5));
}

#[test]
fn the_error_for_an_unknown_option_names_it_and_the_known_ones() {
    for given in ["--rat", "-r", "rate"] {
        let text = usage(Arguments::new([given], KNOWN).next());
        assert!(text.contains(given), "{text}");
        assert!(text.contains("--rate --verbose"), "{text}");
    }
}

#[test]
fn the_error_for_a_mistyped_option_suggests_the_closest_one() {
    let text = usage(Arguments::new(["--rte"], KNOWN).next());
    assert_eq!(
        text,
        "unknown option \"--rte\"; did you mean --rate? expected one of: --rate --verbose"
    );
}

#[test]
fn help_and_version_have_a_short_form_each() {
    let mut arguments = Arguments::new(["-h", "-V"], &["--help", "--version"]);
    assert_eq!(arguments.next(), Ok(Some("--help")));
    assert_eq!(arguments.next(), Ok(Some("--version")));
    usage(Arguments::new(["-h"], KNOWN).next());
}

#[test]
fn the_error_for_an_invalid_value_says_what_was_expected() {
    for given in ["10", "fast", "", "NaN"] {
        let text = usage(rate(&["--rate", given]));
        assert_eq!(
            text,
            format!("invalid value for --rate option: expected 1 to 9, got: {given:?}")
        );
    }
}

#[test]
fn the_error_for_a_missing_value_says_that_it_is_missing() {
    let text = usage(rate(&["--rate"]));
    assert_eq!(
        text,
        "invalid value for --rate option: expected 1 to 9, got: no value"
    );
}

#[test]
fn a_value_for_an_option_without_one_is_an_error() {
    let mut arguments = Arguments::new(["--verbose=yes"], KNOWN);
    assert_eq!(arguments.next(), Ok(Some("--verbose")));
    assert_eq!(
        usage(arguments.next()),
        "invalid value for --verbose option: expected no value, got: \"yes\""
    );
}

#[test]
fn the_error_for_a_missing_required_option_names_it() {
    let text = usage(required::<u8>(None, "--rate", "1 to 9"));
    assert_eq!(text, "--rate option is missing; expected 1 to 9");
}

#[test]
fn next_argument_returns_plain_arguments_too() {
    let mut arguments = Arguments::new(["imu", "--verbose", "--", "--rate"], KNOWN);
    let plain = |text: &str| Ok(Some(Argument::Plain(text.into())));
    assert_eq!(arguments.next_argument(), plain("imu"));
    assert_eq!(
        arguments.next_argument(),
        Ok(Some(Argument::Option("--verbose")))
    );
    assert_eq!(arguments.next_argument(), plain("--rate"));
    assert_eq!(arguments.next_argument(), Ok(None));
}
