//! Programs under test, and the ring topics by which they are watched. Shared by the tests of all programs.

#[path = "../../../conduit_ring/tests/support/run.rs"]
mod run;

use conduit_ring::{Meta, Read, Subscriber, SubscriberOptions, Topic};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// Far longer than anything here takes: only a failure waits for it.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A running program. It is asked to end when dropped, so that it leaves no topic behind.
pub struct Process {
    child: Child,
}

/// What a program left behind.
#[derive(Debug)]
pub struct Ended {
    /// Its exit status; `None` if a signal ended it.
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Process {
    /// Starts a program; its stdin stays open until `close_stdin`.
    pub fn start(program: &str, arguments: &[&str]) -> Process {
        let child = Command::new(program)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        Process { child }
    }

    /// Asks it to end.
    pub fn terminate(&self) {
        // SAFETY: sends a signal to a child that was not waited for, so that its id is still its own.
        let sent = unsafe { libc::kill(self.child.id() as libc::pid_t, libc::SIGTERM) };
        assert_eq!(sent, 0);
    }

    /// Ends it without asking.
    pub fn kill(mut self) {
        self.child.kill().expect("it can be killed");
        self.child.wait().expect("a status");
    }

    pub fn close_stdin(&mut self) {
        drop(self.child.stdin.take());
    }

    /// Waits until it has ended by itself.
    pub fn end(mut self) -> Ended {
        let (mut stdout, mut stderr) = (self.child.stdout.take(), self.child.stderr.take());
        let (sender, receiver) = mpsc::channel();
        thread::spawn(move || {
            let text = (rest_of(stdout.as_mut()), rest_of(stderr.as_mut()));
            let _ = sender.send(text);
        });
        let (stdout, stderr) = receiver.recv_timeout(PATIENCE).expect("the program ends");
        let status = self.child.wait().expect("a status").code();
        Ended {
            status,
            stdout,
            stderr,
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(Some(_))) {
            return;
        }
        self.terminate();
        let deadline = Instant::now() + PATIENCE;
        while matches!(self.child.try_wait(), Ok(None)) && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(2));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn rest_of(pipe: Option<&mut impl std::io::Read>) -> String {
    let mut text = String::new();
    pipe.expect("a pipe")
        .read_to_string(&mut text)
        .expect("text");
    text
}

/// Runs a program to its end.
pub fn call(program: &str, arguments: &[&str]) -> Ended {
    Process::start(program, arguments).end()
}

/// A topic that no other test has.
pub fn unique_topic(name: &str) -> Topic {
    Topic::new(&run::unique(name)).expect("a topic name")
}

/// Subscribes to all messages of a topic, which need not exist yet.
pub fn subscribe(topic: &Topic) -> Subscriber {
    Subscriber::open(topic, &SubscriberOptions::default()).expect("a subscriber")
}

/// The next message.
pub fn next_message(subscriber: &mut Subscriber) -> (Meta, Vec<u8>) {
    let mut message = Vec::new();
    loop {
        match subscriber
            .read_timeout(&mut message, PATIENCE)
            .expect("the ring is readable")
        {
            Read::Message(meta) => return (meta, message),
            Read::Nothing => panic!("no message came on {:?}", subscriber.topic().name()),
            Read::PublisherUp | Read::PublisherDown => {}
        }
    }
}

/// Waits until the topic's publisher is gone, reading what it leaves.
pub fn await_end(subscriber: &mut Subscriber) {
    let mut message = Vec::new();
    loop {
        match subscriber
            .read_timeout(&mut message, PATIENCE)
            .expect("the ring is readable")
        {
            Read::PublisherDown => return,
            Read::Nothing => panic!("{:?} does not end", subscriber.topic().name()),
            _ => {}
        }
    }
}

/// Whether a program said one line that starts with its name, and nothing else.
pub fn said_one_line(ended: &Ended, program: &str) -> bool {
    let start = format!("{program}: ");
    ended.stdout.is_empty() && ended.stderr.starts_with(&start) && ended.stderr.lines().count() == 1
}
