//! `ganglion doctor` with files that killed processes left in /dev/shm.

mod support;

use std::fs::{self, OpenOptions};
use std::os::unix::fs::{FileExt, symlink};

use conduit_ring::{ContentTag, Publisher, PublisherOptions, Topic};
use serde_json::{Value, json};
use support::{Answer, Helper, Scratch, publisher, run, write};

#[test]
fn child() {
    support::play_role();
}

fn doctor(scratch: &Scratch, options: &[&str]) -> Answer {
    let mut arguments = vec!["doctor", "--json", "--prefix", &scratch.prefix];
    arguments.extend(options);
    run(&arguments)
}

/// Returns topic, problem and, with `--fix`, outcome of each finding.
fn findings(answer: &Answer) -> Vec<(String, String, Option<String>)> {
    let text = |value: &Value| value.as_str().map(str::to_owned);
    let lines = answer.json();
    let found = lines.iter().filter(|line| line["event"] == "finding");
    found
        .map(|line| {
            let topic = text(&line["topic"]).unwrap();
            (
                topic,
                text(&line["problem"]).unwrap(),
                text(&line["outcome"]),
            )
        })
        .collect()
}

fn summary(answer: &Answer) -> Value {
    answer.json().pop().unwrap()
}

/// Writes a topic as a legacy publisher creates it.
fn write_legacy(topic: &Topic) {
    let mut file = vec![0; 1216 + 4 * 64];
    for (at, value) in [(0, 4_u32), (4, 64), (8, 16)] {
        file[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
    write(topic, &file);
}

fn set_legacy_bits(topic: &Topic, bits: u8) {
    let file = OpenOptions::new().write(true).open(topic.path()).unwrap();
    file.write_all_at(&[bits], 128).unwrap();
}

#[test]
fn the_leftovers_of_kills_are_repaired_and_live_topics_are_not_disturbed() {
    let scratch = Scratch::alone();
    let live = scratch.topic("live");
    let mut living = publisher(&live, ContentTag::RAW);
    let reader = Helper::start("subscribe", &live);
    let leaking: Vec<_> = (0..3).map(|_| Helper::start("subscribe", &live)).collect();
    leaking.into_iter().for_each(Helper::kill);
    let dead: Vec<Topic> = (0..5)
        .map(|n| scratch.topic(&format!("dead-{n}")))
        .collect();
    for topic in &dead {
        Helper::start("publish", topic).kill();
    }
    let truncated = scratch.topic("truncated");
    Helper::start("hold", &truncated).kill();
    OpenOptions::new()
        .write(true)
        .open(truncated.path())
        .unwrap()
        .set_len(2000)
        .unwrap();
    let empty = scratch.topic("empty");
    write(&empty, b"");

    let found = doctor(&scratch, &[]);
    assert_eq!(found.status, Some(1));
    assert_eq!(
        found.stderr,
        "ganglion: 8 problems found; run ganglion doctor --fix to make the safe repairs\n"
    );
    let problems = findings(&found);
    let problem_of = |topic: &Topic| {
        problems
            .iter()
            .find(|(name, ..)| name == topic.name())
            .map(|(_, problem, _)| problem.as_str())
    };
    assert!(
        dead.iter()
            .all(|topic| problem_of(topic) == Some("publisher_dead"))
    );
    assert_eq!(problem_of(&live), Some("leaked_slots"));
    assert_eq!(problem_of(&truncated), Some("damaged"));
    assert_eq!(problem_of(&empty), Some("damaged"));
    assert_eq!(
        findings(&doctor(&scratch, &[])),
        problems,
        "an examination changes nothing"
    );

    let fixed = doctor(&scratch, &["--fix"]);
    assert_eq!(
        (fixed.status, fixed.stderr.as_str()),
        (Some(0), ""),
        "{fixed:?}"
    );
    assert_eq!(
        summary(&fixed),
        json!({"event": "summary", "topics": 8, "findings": 8, "repaired": 8, "left": 0})
    );
    let gone = dead.iter().chain([&truncated, &empty]);
    assert!(gone.into_iter().all(|topic| !topic.path().exists()));

    let clean = doctor(&scratch, &[]);
    assert_eq!((clean.status, clean.stderr.as_str()), (Some(0), ""));
    assert_eq!(
        clean.json(),
        [json!({"event": "summary", "topics": 1, "findings": 0, "repaired": 0, "left": 0})]
    );
    let readers = living.info().readers;
    assert_eq!(
        readers.iter().map(|r| (r.pid, r.alive)).collect::<Vec<_>>(),
        [(reader.pid(), true)]
    );
    assert_eq!(living.publish(b"still here"), Ok(0));
}

#[test]
fn a_dead_topic_with_a_waiting_reader_is_reported_and_left() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    let publisher = Helper::start("publish", &topic);
    let reader = Helper::start("subscribe", &topic);
    publisher.kill();
    let fixed = doctor(&scratch, &["--fix"]);
    assert_eq!(fixed.status, Some(1));
    assert_eq!(fixed.stderr, "ganglion: 1 problem left\n");
    let line = &fixed.json()[0];
    assert_eq!(
        (&line["problem"], &line["outcome"]),
        (&json!("publisher_dead"), &json!("left"))
    );
    assert!(
        line["detail"]
            .as_str()
            .unwrap()
            .contains(&format!("pid {}", reader.pid()))
    );
    assert!(topic.path().exists());

    let _second = Helper::start("publish", &topic);
    assert_eq!(doctor(&scratch, &[]).status, Some(0));
}

#[test]
fn keep_dead_keeps_a_file_for_a_successor_and_clears_dead_readers_in_it() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    let mut publisher = publisher(&topic, ContentTag::RAW);
    publisher.publish(b"one").unwrap();
    publisher.abandon();
    set_legacy_bits(&topic, 0b110);
    let expected = [(topic.name().to_owned(), "legacy_readers".to_owned(), None)];
    assert_eq!(findings(&doctor(&scratch, &["--keep-dead"])), expected);

    let fixed = doctor(&scratch, &["--keep-dead", "--fix"]);
    assert_eq!(fixed.status, Some(0), "{fixed:?}");
    let mut successor = support::publisher(&topic, ContentTag::RAW);
    assert_eq!(
        (successor.publish(b"two"), successor.info().readers),
        (Ok(1), vec![])
    );
}

#[test]
fn legacy_bits_in_a_live_topic_are_not_touched() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    let publisher = publisher(&topic, ContentTag::RAW);
    set_legacy_bits(&topic, 0b1);
    assert_eq!(doctor(&scratch, &["--fix"]).status, Some(0));
    assert_eq!(publisher.info().readers.len(), 1);
}

#[test]
fn a_legacy_file_is_removed_once_no_process_has_it_open() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    write_legacy(&topic);
    let held = OpenOptions::new()
        .read(true)
        .write(true)
        .open(topic.path())
        .unwrap();
    assert_eq!(doctor(&scratch, &["--fix"]).status, Some(0));
    assert!(topic.path().exists());
    drop(held);
    assert_eq!(doctor(&scratch, &["--fix"]).status, Some(0));
    assert!(!topic.path().exists());
}

#[test]
fn a_foreign_file_is_reported_and_never_touched() {
    let scratch = Scratch::alone();
    let [notes, folder, link] = ["notes", "folder", "link"].map(|name| scratch.topic(name));
    write(&notes, b"buy milk");
    fs::create_dir(folder.path()).unwrap();
    symlink("/etc/hostname", link.path()).unwrap();
    let fixed = doctor(&scratch, &["--fix"]);
    assert_eq!(
        (fixed.status, fixed.stderr.as_str()),
        (Some(1), "ganglion: 3 problems left\n")
    );
    let reported: Vec<_> = findings(&fixed)
        .into_iter()
        .map(|(_, problem, outcome)| (problem, outcome))
        .collect();
    let left = |problem: &str| (problem.to_owned(), Some("left".to_owned()));
    assert_eq!(
        reported,
        [left("foreign"), left("foreign"), left("damaged")]
    );
    assert_eq!(fs::read(notes.path()).unwrap(), b"buy milk");
    assert!(folder.path().is_dir() && link.path().is_symlink());
}

#[test]
fn without_json_a_problem_is_a_line_with_its_repair() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    let publisher = Helper::start("publish", &topic);
    let pid = publisher.pid();
    publisher.kill();
    let path = topic.path().display();
    let answer = run(&["doctor", "--prefix", &scratch.prefix]);
    assert_eq!(
        answer.stdout,
        format!(
            "{path}: publisher with pid {pid} is dead; --fix removes the file\n\
             topics 1  problems 1\n"
        )
    );
    let answer = run(&["doctor", "--prefix", &scratch.prefix, "--fix"]);
    assert_eq!(
        answer.stdout,
        format!(
            "{path}: publisher with pid {pid} is dead: removed\n\
             topics 1  problems 1  repaired 1  left 0\n"
        )
    );
}

#[test]
fn a_successor_starts_after_a_repair() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    Helper::start("publish", &topic).kill();
    assert_eq!(doctor(&scratch, &["--fix"]).status, Some(0));
    let mut publisher = Publisher::open(&topic, &PublisherOptions::default()).unwrap();
    assert_eq!(publisher.publish(b"first"), Ok(0));
}

#[test]
fn a_reader_that_holds_a_slot_for_too_long_is_reported() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    let mut publisher = publisher(&topic, ContentTag::RAW);
    let mut holder = conduit_ring::Subscriber::open(&topic, &Default::default()).unwrap();
    let mut hold = |publisher: &mut Publisher| {
        publisher.publish(b"held").unwrap();
        match holder.try_lease().unwrap() {
            conduit_ring::Received::Message(_, lease) => lease,
            other => panic!("{other:?}"),
        }
    };
    drop(hold(&mut publisher));
    let lease = hold(&mut publisher);
    assert!(lease.holds_slot());
    assert_eq!(doctor(&scratch, &[]).status, Some(0), "not for long yet");
    let slots = u64::from(publisher.geometry().slot_count());
    while publisher.next_sequence() <= 2 * slots {
        publisher.publish(b"on").unwrap();
    }
    let found = doctor(&scratch, &[]);
    let line = &found.json()[0];
    assert_eq!(line["problem"], "held_slots");
    let pid = std::process::id();
    assert_eq!(
        line["holders"],
        json!([{"slot": 0, "pid": pid, "messages": [lease.meta().sequence]}])
    );
    let detail = line["detail"].as_str().unwrap();
    assert!(detail.contains(&format!("pid {pid}")), "{detail}");
    let info = run(&["info", topic.name(), "--json"]);
    assert_eq!(info.json()[0]["readers"][0]["held"], json!([1]));
    drop(lease);
    assert_eq!(doctor(&scratch, &[]).status, Some(0));
}

#[test]
fn a_publisher_whose_file_has_lost_its_name_is_reported() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    let publisher = Helper::start("hold", &topic);
    fs::remove_file(topic.path()).unwrap();
    let found = doctor(&scratch, &["--fix"]);
    assert_eq!(found.status, Some(1));
    let line = &found.json()[0];
    assert_eq!(
        (&line["topic"], &line["problem"], &line["pid"]),
        (
            &json!(topic.name()),
            &json!("nameless"),
            &json!(publisher.pid())
        )
    );
    publisher.kill();
    assert_eq!(doctor(&scratch, &[]).status, Some(0));
}

#[test]
fn a_dead_legacy_publishers_topic_that_our_readers_use_is_reported() {
    let scratch = Scratch::alone();
    let topic = scratch.topic("a");
    write_legacy(&topic);
    let reader = Helper::start("subscribe", &topic);
    let found = doctor(&scratch, &["--fix"]);
    let line = &found.json()[0];
    assert_eq!(
        (&line["problem"], &line["outcome"]),
        (&json!("publisher_dead"), &json!("left"))
    );
    let detail = line["detail"].as_str().unwrap();
    assert!(
        detail.contains(&format!("pid {}", reader.pid())),
        "{detail}"
    );
    let _successor = support::publisher(&topic, ContentTag::RAW);
    assert_eq!(doctor(&scratch, &[]).status, Some(0));
}
