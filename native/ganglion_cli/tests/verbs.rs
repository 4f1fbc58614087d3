//! The verbs that list and print: the real program with real topics.

mod support;

use conduit_ring::{ContentTag, Subscriber, SubscriberOptions};
use ganglion_messages::frame::{self, FrameHeader};
use ganglion_messages::imu::{self, Imu};
use ganglion_messages::tags::{self, TagDetection, TagDetections};
use serde_json::json;
use support::{Helper, Scratch, Watcher, publisher, run, write};

#[test]
fn child() {
    support::play_role();
}

#[test]
fn help_lists_every_verb_and_every_verb_has_its_own() {
    let help = run(&["--help"]);
    assert_eq!((help.status, help.stderr.as_str()), (Some(0), ""));
    for verb in ["topics", "info", "echo", "hz", "bw", "latency", "doctor"] {
        assert!(help.stdout.contains(&format!("\n  {verb}")), "{verb}");
        for call in [[verb, "--help"], [verb, "-h"], ["help", verb]] {
            let help = run(&call);
            assert_eq!((help.status, help.stderr.as_str()), (Some(0), ""));
            assert!(help.stdout.starts_with(&format!("ganglion {verb}: ")));
        }
    }
    for call in ["-h", "help"] {
        assert_eq!(run(&[call]).stdout, help.stdout);
    }
    for call in ["-V", "--version"] {
        let version = run(&[call]);
        let expected = format!("ganglion {}\n", env!("CARGO_PKG_VERSION"));
        assert_eq!((version.status, version.stdout), (Some(0), expected));
    }
}

#[test]
fn a_usage_error_is_one_line_and_status_2() {
    for wrong in [
        &[][..],
        &["hertz"],
        &["hz"],
        &["hz", "a/b"],
        &["echo", "a", "--count", "0"],
    ] {
        let answer = run(wrong);
        assert_eq!(
            (answer.status, answer.stdout.as_str()),
            (Some(2), ""),
            "{wrong:?}"
        );
        assert_eq!(answer.stderr.lines().count(), 1, "{answer:?}");
        assert!(answer.stderr.starts_with("ganglion: "));
        assert!(answer.stderr.contains("expected "), "{answer:?}");
    }
}

#[test]
fn a_missing_or_broken_topic_is_one_line_and_status_1() {
    let scratch = Scratch::new();
    let topic = scratch.topic("camera");
    let _near = publisher(&topic, ContentTag::RAW);
    let mistyped = topic.name().replace("camera", "camara");
    for verb in ["info", "echo", "hz", "bw", "latency"] {
        let answer = run(&[verb, &mistyped]);
        assert_eq!((answer.status, answer.stderr.lines().count()), (Some(1), 1));
        assert!(answer.stderr.starts_with(&format!(
            "ganglion: topic {mistyped} not found; did you mean {}? topics: ",
            topic.name()
        )));
    }

    let topic = scratch.topic("broken");

    write(&topic, &[7; 5000]);
    for verb in ["info", "hz"] {
        let answer = run(&[verb, topic.name()]);
        assert_eq!(
            (answer.status, answer.stderr.lines().count()),
            (Some(1), 1),
            "{answer:?}"
        );
        assert!(answer.stderr.contains("max_subscribers is not 16"));
    }
}

#[test]
fn topics_lists_live_dead_and_broken_topics() {
    let scratch = Scratch::new();
    let [live, dead, broken] = ["live", "dead", "broken"].map(|name| scratch.topic(name));
    let publisher = Helper::start("publish", &live);
    let _reader = Subscriber::open(&live, &SubscriberOptions::default()).unwrap();
    Helper::start("hold", &dead).kill();
    write(&broken, b"not a ring");

    // A publisher that the machine delays may have no rate in one measurement.
    let rows = loop {
        let look = [
            "topics",
            "--prefix",
            &scratch.prefix,
            "--look",
            "0.3",
            "--json",
        ];
        let answer = run(&look);
        assert_eq!((answer.status, answer.stderr.as_str()), (Some(0), ""));
        let rows = answer.json();
        if rows
            .last()
            .is_some_and(|row| row["rate_hz"].as_f64() > Some(1.0))
        {
            break rows;
        }
    };
    let names: Vec<_> = rows
        .iter()
        .map(|row| row["topic"].as_str().unwrap())
        .collect();
    assert_eq!(names, [broken.name(), dead.name(), live.name()]);
    assert_eq!(rows[0]["state"], "broken");
    assert_eq!(rows[0]["fault"], "not initialised");
    assert_eq!(
        (&rows[1]["state"], &rows[1]["rate_hz"]),
        (&json!("dead"), &json!(0.0))
    );
    assert_eq!(rows[1]["age_s"], json!(null));

    let row = &rows[2];
    assert_eq!(
        (&row["state"], &row["pid"]),
        (&json!("live"), &json!(publisher.pid()))
    );
    assert_eq!(
        (&row["readers"], &row["slot_count"]),
        (&json!(1), &json!(16))
    );
    assert_eq!(
        (&row["slot_size"], &row["max_message_size"]),
        (&json!(4032), &json!(4000))
    );
    assert_eq!(row["content"], "raw");
    assert!(row["age_s"].as_f64().unwrap() < 60.0, "{row}");

    let text = run(&["topics", "--prefix", &scratch.prefix, "--look", "0.01"]).stdout;
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 4);
    assert!(lines[0].starts_with("TOPIC ") && lines[3].contains("live"));
    let column = lines[0].find("STATE").unwrap();
    assert!(lines[3][column..].starts_with("live "), "{text}");
}

#[test]
fn info_shows_whether_each_reader_is_alive() {
    let scratch = Scratch::new();
    let topic = scratch.topic("a");
    let mut publisher = publisher(&topic, ContentTag::of("sensor_msgs/msg/Range"));
    Helper::start("subscribe", &topic).kill();
    let second = Helper::start("subscribe", &topic);
    let third = Helper::start("subscribe", &topic);
    // The second reader reclaimed the first one's slot.
    let killed = third.pid();
    third.kill();
    for n in 0..3_u8 {
        publisher.publish(&[n]).unwrap();
    }

    let info = &run(&["info", topic.name(), "--json"]).json()[0];
    assert_eq!(
        (&info["topic"], &info["state"]),
        (&json!(topic.name()), &json!("live"))
    );
    assert_eq!(
        (&info["pid"], &info["published"]),
        (&json!(std::process::id()), &json!(3))
    );
    assert_eq!(
        (&info["epoch"], &info["content"]),
        (&json!(0), &json!("sensor_msgs/msg/Range"))
    );
    let readers = info["readers"].as_array().unwrap();
    assert_eq!(readers.len(), 2);
    assert_eq!(
        (&readers[0]["alive"], &readers[0]["pid"]),
        (&json!(true), &json!(second.pid()))
    );
    assert_eq!(
        (&readers[1]["alive"], &readers[1]["pid"]),
        (&json!(false), &json!(killed))
    );
    assert_eq!(
        (&readers[0]["next_sequence"], &readers[0]["lost"]),
        (&json!(0), &json!(0))
    );

    let text = run(&["info", topic.name()]).stdout;
    assert!(text.contains("\nreaders     2 of 16\n"), "{text}");
    assert!(text.contains("dead, slot leaked"), "{text}");
}

#[test]
fn echo_decodes_the_encoding_that_the_content_tag_names() {
    let scratch = Scratch::new();
    let imu = Imu {
        frame_id: "imu".into(),
        linear_acceleration: [0.0, 0.5, 9.75],
        ..Imu::default()
    };
    let tag = TagDetection {
        family: "tag36h11".into(),
        id: 7,
        ..TagDetection::default()
    };
    let seen = TagDetections {
        detections: vec![tag],
        ..TagDetections::default()
    };
    let header = FrameHeader::grey(8, 4, 5, 6);
    let frame = [&header.encode()[..], &[0; 32]].concat();
    let cases = [
        (
            imu::ENCODING,
            imu.encode(),
            "/linear_acceleration/2",
            json!(9.75),
            "[0.0, 0.5, 9.75]",
        ),
        (
            tags::ENCODING,
            seen.encode(),
            "/detections/0/id",
            json!(7),
            "- family: tag36h11",
        ),
        (frame::ENCODING, frame, "/height", json!(4), "fourcc: GREY"),
    ];
    for (n, (encoding, message, field, value, text)) in cases.into_iter().enumerate() {
        let topic = scratch.topic(&n.to_string());
        let mut publisher = publisher(&topic, ContentTag::of(encoding));
        publisher.publish(&message).unwrap();
        let answer = run(&["echo", topic.name(), "--latest", "--count", "1", "--json"]);
        assert_eq!((answer.status, answer.stderr.as_str()), (Some(0), ""));
        let line = &answer.json()[0];
        assert_eq!(
            (&line["event"], &line["content"]),
            (&json!("message"), &json!(encoding))
        );
        assert_eq!(
            (&line["sequence"], &line["bytes"]),
            (&json!(0), &json!(message.len()))
        );
        assert_eq!(line["message"].pointer(field), Some(&value), "{line}");

        let answer = run(&["echo", topic.name(), "--latest", "--count", "1"]);
        assert!(
            answer
                .stdout
                .starts_with(&format!("#0  {} bytes  {encoding}", message.len()))
        );
        assert!(answer.stdout.contains(text), "{}", answer.stdout);

        let answer = run(&[
            "echo",
            topic.name(),
            "--latest",
            "--count",
            "1",
            "--raw",
            "--json",
        ]);
        let hex: String = message.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(answer.json()[0]["hex"], hex);
    }
}

#[test]
fn echo_prints_the_bytes_of_a_message_that_it_cannot_decode() {
    let scratch = Scratch::new();
    let [raw, wrong] = ["raw", "wrong"].map(|name| scratch.topic(name));
    let mut of_raw = publisher(&raw, ContentTag::RAW);
    of_raw.publish(&[b'A'; 300]).unwrap();
    let echo = |topic: &conduit_ring::Topic, option| {
        run(&["echo", topic.name(), "--latest", "--count", "1", option])
    };
    let text = run(&["echo", raw.name(), "--latest", "--count", "1"]).stdout;
    assert!(text.contains("\n  000000  41 41 41"), "{text}");
    assert!(text.ends_with("\n  … 44 more bytes\n"), "{text}");
    assert_eq!(echo(&raw, "--json").json()[0]["hex"], "41".repeat(256));
    assert_eq!(
        echo(&raw, "--raw").stdout.lines().count(),
        1 + 300_usize.div_ceil(16)
    );

    let mut of_wrong = publisher(&wrong, ContentTag::of(imu::ENCODING));
    of_wrong.publish(b"short").unwrap();
    let line = &echo(&wrong, "--json").json()[0];
    assert_eq!(line["hex"], "73686f7274");
    assert!(line["not_decoded"].is_string());
}

#[test]
fn echo_takes_no_reader_slot_and_ends_when_its_output_is_closed() {
    let scratch = Scratch::new();
    let topic = scratch.topic("a");
    let _publisher = Helper::start("publish", &topic);
    let mut echo = Watcher::start(&["echo", topic.name(), "--json"]);
    let line = echo.json_with(|line| line["event"] == "message");
    assert_eq!(line["bytes"], 8);
    let info = &run(&["info", topic.name(), "--json"]).json()[0];
    assert_eq!(info["readers"], json!([]));
    let (status, stderr) = echo.hang_up();
    assert_eq!((status.code(), stderr.as_str()), (Some(0), ""));
}
