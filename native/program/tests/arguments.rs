//! How options are taken and refused.

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
fn a_value_stands_behind_its_option_or_after_an_equals_sign() {
    assert_eq!(rate(&["--rate", "2.5"]), Ok(2.5));
    assert_eq!(rate(&["--rate=2.5"]), Ok(2.5));
}

#[test]
fn an_unknown_option_is_named_with_those_that_exist() {
    for given in ["--rat", "-r", "rate"] {
        let text = usage(Arguments::new([given], KNOWN).next());
        assert!(text.contains(given), "{text}");
        assert!(text.contains("--rate --verbose"), "{text}");
    }
}

#[test]
fn a_slip_is_told_with_what_was_meant() {
    let text = usage(Arguments::new(["--rte"], KNOWN).next());
    assert_eq!(
        text,
        "there is no option \"--rte\"; did you mean --rate? accepted: --rate --verbose"
    );
}

#[test]
fn help_and_version_have_a_letter_each() {
    let mut arguments = Arguments::new(["-h", "-V"], &["--help", "--version"]);
    assert_eq!(arguments.next(), Ok(Some("--help")));
    assert_eq!(arguments.next(), Ok(Some("--version")));
    usage(Arguments::new(["-h"], KNOWN).next());
}

#[test]
fn a_wrong_value_is_named_with_what_is_accepted() {
    for given in ["10", "fast", "", "NaN"] {
        let text = usage(rate(&["--rate", given]));
        assert_eq!(
            text,
            format!("--rate was given {given:?}; accepted: 1 to 9")
        );
    }
}

#[test]
fn a_missing_value_is_said_to_be_missing() {
    let text = usage(rate(&["--rate"]));
    assert_eq!(text, "--rate was given no value; accepted: 1 to 9");
}

#[test]
fn a_value_where_none_belongs_is_refused() {
    let mut arguments = Arguments::new(["--verbose=yes"], KNOWN);
    assert_eq!(arguments.next(), Ok(Some("--verbose")));
    assert_eq!(
        usage(arguments.next()),
        "--verbose was given a value; accepted: no value"
    );
}

#[test]
fn a_required_option_that_is_missing_is_named() {
    let text = usage(required::<u8>(None, "--rate", "1 to 9"));
    assert_eq!(text, "--rate is missing; accepted: 1 to 9");
}

#[test]
fn other_arguments_than_options_are_given_to_who_asks_for_them() {
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
