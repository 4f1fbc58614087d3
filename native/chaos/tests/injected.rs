//! A run finds each injected fault and exits with 1. Without a fault it exits with 0.

use std::process::{Command, Output};

const NAMES: [&str; 6] = ["kills", "messages", "torn", "stuck", "leaked", "reused"];

fn chaos(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_chaos"))
        .args(arguments)
        .output()
        .unwrap()
}

/// Runs the program without BEAM nodes. Returns the numbers of the JSON line and the exit status.
fn run(extra: &[&str]) -> ([u64; 6], i32) {
    let output = chaos(&[&["ring", "--kills", "60", "--seed", "7", "--json"], extra].concat());
    let text = String::from_utf8(output.stdout).unwrap();
    let last = text.lines().last().expect("a line");
    let numbers = NAMES.map(|name| {
        let (_, after) = last.split_once(&format!("\"{name}\": ")).expect(name);
        let digits = after.split([',', '}']).next().unwrap();
        digits.parse().unwrap()
    });
    (numbers, output.status.code().unwrap())
}

/// Long enough for a busy machine, on which a slow topic would count as stuck.
const PATIENT: [&str; 2] = ["--patience", "120"];
/// For runs that wait for the whole time.
const LESS_PATIENT: [&str; 2] = ["--patience", "20"];

/// Checks that a run finds the injected fault, and besides it only the counts in `may_follow`.
///
/// * From `torn` no other count follows.
/// * From `reused` may follow `torn`: the second message with a number overwrites the first, and
///   a reader that copies meanwhile finds the expected number before and after.
/// * From `stuck` may follow `leaked`: a reader has the same patience to move to another segment
///   as the topic to deliver messages.
/// * From `leaked` no other count follows, because the slot is marked after the recovery.
fn check(inject: &str, patience: [&str; 2], may_follow: &[&str]) {
    let (numbers, status) = run(&["--inject", inject, patience[0], patience[1]]);
    for (name, count) in NAMES.into_iter().zip(numbers).skip(2) {
        if name == inject {
            assert!(count > 0, "{inject} was not found: {numbers:?}");
        } else if !may_follow.contains(&name) {
            assert_eq!(
                count, 0,
                "{name} does not follow from {inject}: {numbers:?}"
            );
        }
    }
    assert_eq!(status, 1);
}

#[test]
fn without_a_fault_nothing_is_found() {
    let (numbers, status) = run(&PATIENT);
    assert_eq!((&numbers[2..], status), (&[0; 4][..], 0));
    assert_eq!(numbers[0], 60);
    assert!(numbers[1] > 100, "{numbers:?}");
}

#[test]
fn torn_messages_are_found() {
    check("torn", PATIENT, &[]);
}

#[test]
fn a_reused_sequence_number_is_found() {
    check("reused", PATIENT, &["torn"]);
}

#[test]
fn a_topic_that_its_publisher_cannot_open_is_found() {
    check("stuck", ["--patience", "2"], &["leaked"]);
}

#[test]
fn a_leaked_reader_slot_is_found() {
    check("leaked", LESS_PATIENT, &[]);
}

#[test]
fn the_error_for_invalid_arguments_names_the_expected_ones() {
    for (arguments, expected) in [
        (&[][..], "ring"),
        (&["topology"], "ring"),
        (&["ring", "--kills", "0"], "a number from 1"),
        (&["ring", "--inject", "x"], "torn, reused, stuck, leaked"),
        (&["ring", "--fast"], "--kills"),
    ] {
        let output = chaos(arguments);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text.contains(expected), "{text}");
    }
}
