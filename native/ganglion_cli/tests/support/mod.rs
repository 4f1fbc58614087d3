//! Topics with unique names, child processes that publish or subscribe, and the program itself.
#![allow(dead_code)]

#[path = "../../../conduit_ring/tests/support/run.rs"]
mod run;

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use conduit_ring::{
    ContentTag, Geometry, Publisher, PublisherOptions, Subscriber, SubscriberOptions, Topic,
};
use serde_json::Value;

const ROLE: &str = "GANGLION_TEST_ROLE";
const TOPIC: &str = "GANGLION_TEST_TOPIC";

/// Topic names with a unique prefix. Their files are removed on drop.
pub struct Scratch {
    pub prefix: String,
    lock: Option<MutexGuard<'static, ()>>,
}

impl Scratch {
    pub fn new() -> Scratch {
        Scratch {
            prefix: run::unique("cli."),
            lock: None,
        }
    }

    /// Runs one test at a time. A child that another test is starting inherits the files of this
    /// process until it executes its program, so that they would be in use.
    pub fn alone() -> Scratch {
        static LOCK: Mutex<()> = Mutex::new(());
        let mut scratch = Scratch::new();
        scratch.lock = Some(LOCK.lock().unwrap_or_else(PoisonError::into_inner));
        scratch
    }

    pub fn topic(&self, name: &str) -> Topic {
        Topic::new(&format!("{}{name}", self.prefix)).unwrap()
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        for entry in std::fs::read_dir("/dev/shm").unwrap().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.starts_with(&format!("conduit_{}", self.prefix)) {
                let _ = std::fs::remove_file(entry.path())
                    .or_else(|_| std::fs::remove_dir(entry.path()));
            }
        }
    }
}

pub fn publisher(topic: &Topic, content: ContentTag) -> Publisher {
    let options = PublisherOptions {
        geometry: Geometry::depth(16, 4000).unwrap(),
        content,
        ..PublisherOptions::default()
    };
    Publisher::open(topic, &options).unwrap()
}

/// Runs a helper process, called by a test named `child`. It publishes 100 times per second, or
/// holds a topic or a reader slot, until it is killed.
pub fn play_role() {
    let Ok(role) = std::env::var(ROLE) else {
        return;
    };
    let topic = Topic::new(&std::env::var(TOPIC).unwrap()).unwrap();
    match role.as_str() {
        "publish" => publish_for_ever(&topic),
        "hold" => hold(publisher(&topic, ContentTag::RAW)),
        "subscribe" => hold(Subscriber::open(&topic, &SubscriberOptions::default()).unwrap()),
        other => panic!("no role {other}"),
    }
}

fn publish_for_ever(topic: &Topic) {
    let mut publisher = publisher(topic, ContentTag::RAW);
    print_ready();
    for n in 0_u64.. {
        publisher.publish(&n.to_le_bytes()).unwrap();
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn hold<T>(_held: T) {
    print_ready();
    loop {
        std::thread::park();
    }
}

fn print_ready() {
    println!("\nready");
}

/// This test binary as another process with a role.
pub struct Helper {
    child: Child,
    _lines: BufReader<ChildStdout>,
}

impl Helper {
    /// Starts the process and waits until it is ready.
    pub fn start(role: &str, topic: &Topic) -> Helper {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "child", "--nocapture", "--test-threads=1"])
            .env(ROLE, role)
            .env(TOPIC, topic.name())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        while line.trim() != "ready" {
            line.clear();
            assert_ne!(lines.read_line(&mut line).unwrap(), 0, "the helper ended");
        }
        Helper {
            child,
            _lines: lines,
        }
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Kills the process, which must be running.
    pub fn kill(mut self) {
        assert_eq!(
            self.child.try_wait().unwrap(),
            None,
            "the helper ended by itself"
        );
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Output and exit status of `ganglion`.
#[derive(Debug)]
pub struct Answer {
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Answer {
    /// Returns the lines of stdout, each a JSON object.
    pub fn json(&self) -> Vec<Value> {
        self.stdout.lines().map(object).collect()
    }
}

fn object(line: &str) -> Value {
    let value: Value = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
    assert!(value.is_object(), "{line}");
    value
}

fn ganglion(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ganglion"));
    command.args(arguments).stdin(Stdio::null());
    command
}

/// Runs `ganglion` to its end.
pub fn run(arguments: &[&str]) -> Answer {
    let output = ganglion(arguments).output().unwrap();
    Answer {
        status: output.status.code(),
        stdout: String::from_utf8(output.stdout).unwrap(),
        stderr: String::from_utf8(output.stderr).unwrap(),
    }
}

/// A running `ganglion` that watches a topic.
pub struct Watcher {
    child: Child,
    lines: BufReader<ChildStdout>,
}

impl Watcher {
    pub fn start(arguments: &[&str]) -> Watcher {
        let mut child = ganglion(arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        Watcher { child, lines }
    }

    /// Returns the next line of stdout that `wished` accepts.
    pub fn line_with(&mut self, wished: impl Fn(&str) -> bool) -> String {
        loop {
            let mut line = String::new();
            assert_ne!(
                self.lines.read_line(&mut line).unwrap(),
                0,
                "ganglion ended"
            );
            if wished(&line) {
                return line;
            }
        }
    }

    /// Returns the next JSON line that `wished` accepts.
    pub fn json_with(&mut self, wished: impl Fn(&Value) -> bool) -> Value {
        object(&self.line_with(|line| wished(&object(line))))
    }

    /// Sends SIGINT, as Ctrl-C does, and waits for the end.
    pub fn interrupt(mut self) -> ExitStatus {
        let pid = self.child.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-INT", &pid])
                .status()
                .unwrap()
                .success()
        );
        self.child.wait().unwrap()
    }

    /// Closes its output and waits for its end.
    pub fn hang_up(mut self) -> (ExitStatus, String) {
        drop(self.lines);
        let status = self.child.wait().unwrap();
        let mut stderr = String::new();
        self.child
            .stderr
            .take()
            .unwrap()
            .read_to_string(&mut stderr)
            .unwrap();
        (status, stderr)
    }
}

/// Writes a file in a topic's place.
pub fn write(topic: &Topic, bytes: &[u8]) {
    std::fs::File::create(topic.path())
        .unwrap()
        .write_all(bytes)
        .unwrap();
}
