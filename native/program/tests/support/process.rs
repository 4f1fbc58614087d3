//! Programs under test and the ring topics that a test watches. All programs' tests share this
//! file.

#[path = "../../../conduit_ring/tests/support/run.rs"]
mod run;

use conduit_ring::{Meta, Read, Subscriber, SubscriberOptions, Topic};
use std::ops::Deref;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// The timeout of every wait, far longer than a passing test needs.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A running program. Dropping it terminates the program, so that no topic remains.
pub struct Process {
    child: Child,
}

/// Exit status and output of a program that has ended.
#[derive(Debug)]
pub struct Ended {
    /// The exit status; `None` if a signal ended the program.
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Process {
    /// Starts a program. Its stdin stays open until [`Process::close_stdin`].
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

    /// Sends SIGTERM.
    pub fn terminate(&self) {
        // SAFETY: kill takes two numbers; the child was not waited for, so its id is still its
        // own.
        let sent = unsafe { libc::kill(self.child.id() as libc::pid_t, libc::SIGTERM) };
        assert_eq!(sent, 0);
    }

    /// Sends SIGKILL and waits for the end.
    pub fn kill(mut self) {
        self.child.kill().expect("it can be killed");
        self.child.wait().expect("a status");
    }

    pub fn close_stdin(&mut self) {
        drop(self.child.stdin.take());
    }

    /// Waits until the program has ended by itself.
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

/// A topic whose name no other test uses. Its file is removed afterwards, since a program that
/// was killed leaves it.
pub struct TestTopic(Topic);

impl Deref for TestTopic {
    type Target = Topic;

    fn deref(&self) -> &Topic {
        &self.0
    }
}

impl Drop for TestTopic {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(self.0.path());
    }
}

/// Returns a new topic.
pub fn unique_topic(name: &str) -> TestTopic {
    TestTopic(Topic::new(&run::unique(name)).expect("a topic name"))
}

/// Subscribes to all messages of a topic, which need not exist yet.
pub fn subscribe(topic: &Topic) -> Subscriber {
    Subscriber::open(topic, &SubscriberOptions::default()).expect("a subscriber")
}

/// Returns the next message.
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

/// Waits until the topic's publisher is gone and discards its messages.
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

/// Returns whether the program printed exactly one line, which starts with its name.
pub fn printed_one_line(ended: &Ended, program: &str) -> bool {
    let start = format!("{program}: ");
    let lines = ended.stderr.lines().count();
    ended.stdout.is_empty() && ended.stderr.starts_with(&start) && lines == 1
}
