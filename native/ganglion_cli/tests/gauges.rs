//! The verbs that measure: their output, and that they continue after their publisher's death.

mod support;

use serde_json::{Value, json};
use support::{Helper, Scratch, Watcher, run};

#[test]
fn child() {
    support::play_role();
}

#[test]
fn hz_continues_when_its_publisher_is_killed_and_started_again_and_reports_it() {
    let scratch = Scratch::new();
    let topic = scratch.topic("a");
    let first = Helper::start("publish", &topic);
    let mut hz = Watcher::start(&[
        "hz",
        topic.name(),
        "--every",
        "0.1",
        "--window",
        "1",
        "--json",
    ]);
    let line = hz.json_with(|line| line["event"] == "hz" && line["mean_ms"].is_f64());
    assert_eq!(
        (&line["topic"], &line["publisher"]),
        (&json!(topic.name()), &json!("up"))
    );

    first.kill();
    hz.json_with(|line| line["event"] == "publisher_down");
    hz.json_with(|line| line["event"] == "hz" && line["publisher"] == "down");
    // Longer than the machine delays a publisher.
    let long = |line: &Value| line["silent_s"].as_f64().is_some_and(|s| s > 3.0);
    let silent = hz.json_with(long);
    assert_eq!(silent["rate_hz"], json!(0.0));
    assert_eq!(silent["mean_ms"], json!(null));

    let second = Helper::start("publish", &topic);
    let up = hz.json_with(|line| line["event"] == "publisher_up");
    assert_eq!(
        (&up["pid"], &up["restarted"]),
        (&json!(second.pid()), &json!(true))
    );
    assert_eq!(up["epoch"], 1);
    let line = hz.json_with(|line| line["event"] == "hz" && line["mean_ms"].is_f64());
    assert!(
        line["max_ms"].as_f64().unwrap() < 3000.0,
        "the pause is not a period: {line}"
    );
    assert_eq!(hz.interrupt().code(), Some(0));
}

#[test]
fn hz_detects_a_publisher_that_is_replaced_at_once() {
    let scratch = Scratch::new();
    let topic = scratch.topic("a");
    let mut old = Helper::start("publish", &topic);
    let mut hz = Watcher::start(&["hz", topic.name(), "--every", "0.05", "--json"]);
    hz.json_with(|line| line["mean_ms"].is_f64());
    for epoch in 1..4 {
        old.kill();
        old = Helper::start("publish", &topic);
        let up = hz.json_with(|line| line["event"] == "publisher_up");
        assert_eq!(
            (&up["epoch"], &up["pid"]),
            (&json!(epoch), &json!(old.pid()))
        );
    }
}

#[test]
fn hz_waits_for_a_topic_and_prints_the_changes_of_its_publisher() {
    let scratch = Scratch::new();
    let topic = scratch.topic("a");
    let mut hz = Watcher::start(&["hz", topic.name(), "--wait", "--every", "0.1"]);
    hz.line_with(|line| line.contains("publisher absent"));
    let publisher = Helper::start("publish", &topic);
    let started = hz.line_with(|line| line.starts_with("-- "));
    assert!(
        started.starts_with(&format!("-- publisher started: pid {}", publisher.pid())),
        "{started}"
    );
    let line = hz.line_with(|line| line.contains("period mean "));
    for word in [
        " Hz  ",
        "  min ",
        "  max ",
        "  sd ",
        "  messages ",
        "  lost 0",
    ] {
        assert!(line.contains(word), "{word}: {line}");
    }
    publisher.kill();
    hz.line_with(|line| line == "-- publisher stopped\n");
    assert_eq!(hz.interrupt().code(), Some(0));
}

#[test]
fn bw_prints_bytes_per_second_and_sizes() {
    let scratch = Scratch::new();
    let topic = scratch.topic("a");
    let _publisher = Helper::start("publish", &topic);
    let answer = run(&[
        "bw",
        topic.name(),
        "--every",
        "0.3",
        "--count",
        "2",
        "--json",
    ]);
    assert_eq!((answer.status, answer.stderr.as_str()), (Some(0), ""));
    assert_eq!(answer.json().len(), 2);

    let mut bw = Watcher::start(&["bw", topic.name(), "--every", "0.3", "--json"]);
    let line = bw.json_with(|line| line["messages_per_s"].as_f64() > Some(0.0));
    assert_eq!(
        (&line["event"], &line["min_bytes"]),
        (&json!("bw"), &json!(8))
    );
    assert_eq!(
        (&line["mean_bytes"], &line["max_bytes"]),
        (&json!(8.0), &json!(8))
    );
    let messages = line["messages_per_s"].as_f64().unwrap();
    let bytes = line["bytes_per_s"].as_f64().unwrap();
    assert!((bytes - 8.0 * messages).abs() < 1.0, "{line}");
    assert_eq!(bw.interrupt().code(), Some(0));
    let mut bw = Watcher::start(&["bw", topic.name(), "--every", "0.2"]);
    let text = bw.line_with(|line| line.contains("size mean"));
    assert!(
        text.contains("B/s") && text.contains("size mean 8  min 8  max 8 B"),
        "{text}"
    );
    assert_eq!(bw.interrupt().code(), Some(0));
}

#[test]
fn latency_prints_percentiles_in_order() {
    let scratch = Scratch::new();
    let topic = scratch.topic("a");
    let _publisher = Helper::start("publish", &topic);
    let mut latency = Watcher::start(&["latency", topic.name(), "--every", "0.5", "--json"]);
    let line = latency.json_with(|line| line["window_messages"].as_u64() > Some(0));
    assert_eq!(line["event"], "latency");
    let [p50, p99, max] = ["p50_us", "p99_us", "max_us"].map(|name| line[name].as_f64().unwrap());
    assert!(0.0 < p50 && p50 <= p99 && p99 <= max, "{line}");
    assert_eq!(latency.interrupt().code(), Some(0));
    let mut latency = Watcher::start(&["latency", topic.name(), "--every", "0.2"]);
    let text = latency.line_with(|line| line.starts_with("p50 "));
    assert!(text.contains("  p99 ") && text.contains("  max "), "{text}");
    assert_eq!(latency.interrupt().code(), Some(0));
}
