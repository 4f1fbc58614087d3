//! The run finds what it looks for: each fault, made on purpose, is counted and ends it with status 1; without one it ends with 0.

use std::process::{Command, Output};

const NAMES: [&str; 6] = ["kills", "messages", "torn", "stuck", "leaked", "reused"];

fn chaos(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_chaos"))
        .args(arguments)
        .output()
        .unwrap()
}

/// The numbers of the last line of a short run without BEAM nodes, and its exit status.
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

/// Long enough for a machine that is busy with something else: with less, a topic that is merely slow counts as stuck.
const PATIENT: [&str; 2] = ["--patience", "120"];
/// For runs that wait for it to the end.
const LESS_PATIENT: [&str; 2] = ["--patience", "20"];

/// Checks a run with a fault against what can follow from it. All else must be zero: `torn`, `stuck`, `leaked` and `reused`
/// follow from each other like this.
///
/// | injected | follows for sure | may follow |
/// |---|---|---|
/// | `torn` | `torn` | nothing: a message that was spoiled says nothing about its number, and its neighbours flow |
/// | `reused` | `reused` | `torn`: the second message of a number is written over the first, and a reader that copies meanwhile finds the number that it expects, before and after |
/// | `stuck` | `stuck` | `leaked`: a reader that follows the topic to another segment is given as long as the topic to flow |
/// | `leaked` | `leaked` | nothing: the slot is marked after everything has flowed again |
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
fn a_number_given_twice_is_found() {
    check("reused", PATIENT, &["torn"]);
}

#[test]
fn a_topic_that_no_publisher_gets_is_found() {
    check("stuck", ["--patience", "2"], &["leaked"]);
}

#[test]
fn a_reader_slot_that_nobody_can_get_is_found() {
    check("leaked", LESS_PATIENT, &[]);
}

#[test]
fn a_wrong_call_says_what_is_accepted() {
    for (arguments, accepted) in [
        (&[][..], "ring"),
        (&["topology"], "ring"),
        (&["ring", "--kills", "0"], "a number from 1"),
        (&["ring", "--inject", "x"], "torn, reused, stuck, leaked"),
        (&["ring", "--fast"], "--kills"),
    ] {
        let output = chaos(arguments);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text.contains(accepted), "{text}");
    }
}
