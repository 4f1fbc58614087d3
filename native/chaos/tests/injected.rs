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

fn names_found(numbers: [u64; 6]) -> Vec<&'static str> {
    let found = NAMES.into_iter().zip(numbers).skip(2);
    found
        .filter(|(_, n)| *n > 0)
        .map(|(name, _)| name)
        .collect()
}

#[test]
fn without_a_fault_nothing_is_found() {
    let (numbers, status) = run(&[]);
    assert_eq!((names_found(numbers), status), (vec![], 0));
    assert_eq!(numbers[0], 60);
    assert!(numbers[1] > 100, "{numbers:?}");
}

#[test]
fn torn_messages_are_found() {
    let (numbers, status) = run(&["--inject", "torn"]);
    assert_eq!((names_found(numbers), status), (vec!["torn"], 1));
}

#[test]
fn a_number_given_twice_is_found() {
    let (numbers, status) = run(&["--inject", "reused"]);
    assert_eq!((names_found(numbers), status), (vec!["reused"], 1));
}

#[test]
fn a_topic_that_no_publisher_gets_is_found() {
    let (numbers, status) = run(&["--inject", "stuck", "--patience", "2"]);
    assert_eq!((names_found(numbers), status), (vec!["stuck"], 1));
}

#[test]
fn a_reader_slot_that_nobody_can_get_is_found() {
    let (numbers, status) = run(&["--inject", "leaked", "--patience", "2"]);
    assert_eq!((names_found(numbers), status), (vec!["leaked"], 1));
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
