//! Shared by the tests: topics that leave no file behind, messages with a checksum, child
//! processes, and a raw view of a segment with which legacy peers and damage are made.
#![allow(dead_code)]

pub mod run;

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader};
use std::ops::Deref;
use std::os::fd::AsRawFd;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::ptr;
use std::sync::atomic::{AtomicU32, AtomicU64};
use std::time::Duration;

use conduit_ring::{Read, Subscriber, Topic};

/// Longer than anything here takes: only a failing test waits so long.
pub const LONG: Duration = Duration::from_secs(60);

/// A topic with a unique name. Whatever has its name in the end is removed.
pub struct Scratch(Topic);

impl Scratch {
    pub fn new() -> Scratch {
        Scratch(Topic::new(&run::unique("ring")).unwrap())
    }

    /// A topic whose name begins with characters that this crate's publishers do not use.
    pub fn found(beginning: &str) -> Scratch {
        let name = format!("{beginning} {}", run::unique("ring"));
        Scratch(Topic::found(&name).unwrap())
    }
}

impl Deref for Scratch {
    type Target = Topic;

    fn deref(&self) -> &Topic {
        &self.0
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let path = self.0.path();
        let _ = std::fs::remove_file(path).or_else(|_| std::fs::remove_dir(path));
    }
}

/// Makes a message: number, length and checksum, then a body that follows from the number.
pub fn proving_message(n: u64, len: usize) -> Vec<u8> {
    let len = len.max(24);
    let mut message = vec![0; 24];
    let mut state = n | 1;
    message.extend((24..len).map(|_| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(n);
        (state >> 56) as u8
    }));
    message[..8].copy_from_slice(&n.to_le_bytes());
    message[8..16].copy_from_slice(&(len as u64).to_le_bytes());
    let sum = checksum(&message);
    message[16..24].copy_from_slice(&sum.to_le_bytes());
    message
}

/// Returns the number of a whole message.
pub fn proven_number(message: &[u8]) -> Result<u64, String> {
    let field = |at: usize| {
        message
            .get(at..at + 8)
            .map(|bytes| u64::from_le_bytes(bytes.try_into().unwrap()))
    };
    let (Some(n), Some(len), Some(sum)) = (field(0), field(8), field(16)) else {
        return Err(format!("{} bytes", message.len()));
    };
    if len != message.len() as u64 || sum != checksum(message) {
        return Err(format!(
            "message {n}: {} bytes, {len} stated, checksum {sum:x}",
            message.len()
        ));
    }
    Ok(n)
}

fn checksum(message: &[u8]) -> u64 {
    let covered = message[..16].iter().chain(&message[24..]);
    covered.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// Returns the next message or change.
pub fn next(subscriber: &mut Subscriber, buffer: &mut Vec<u8>) -> Read {
    match subscriber.read_timeout(buffer, LONG).unwrap() {
        Read::Nothing => panic!("nothing for {LONG:?}"),
        read => read,
    }
}

/// Returns the next message's number and the losses before it, whatever the publisher does
/// meanwhile.
pub fn next_message(subscriber: &mut Subscriber, buffer: &mut Vec<u8>) -> (u64, u64) {
    loop {
        if let Read::Message(meta) = next(subscriber, buffer) {
            return (meta.sequence, meta.lost);
        }
    }
}

/// This test binary again, as another process that runs only the test called `child`.
pub struct Helper {
    child: Child,
    lines: BufReader<ChildStdout>,
}

const ROLE: &str = "CONDUIT_RING_TEST_ROLE";
const TOPIC: &str = "CONDUIT_RING_TEST_TOPIC";
/// The command that runs this program, where the kernel cannot start it: `bin/test cross` names
/// the emulator of another machine.
const EMULATOR: &str = "CONDUIT_RING_TEST_EMULATOR";

/// Returns role and topic in a helper process, `None` in others.
pub fn role() -> Option<(String, Topic)> {
    let role = std::env::var(ROLE).ok()?;
    Some((role, Topic::new(&std::env::var(TOPIC).unwrap()).unwrap()))
}

/// Returns the command that starts this program again.
fn this_program() -> Command {
    let program = std::env::current_exe().unwrap();
    let Ok(emulator) = std::env::var(EMULATOR) else {
        return Command::new(program);
    };
    let mut words = emulator.split_whitespace();
    let mut command = Command::new(words.next().unwrap());
    command.args(words).arg(program);
    command
}

/// Reports to the parent that the helper is ready.
pub fn report_ready() {
    println!("\nready");
}

impl Helper {
    /// Starts a helper and waits until it is ready.
    pub fn start(role: &str, topic: &Topic) -> Helper {
        Helper::start_in(role, topic, &[])
    }

    /// As [`Helper::start`], with variables in its environment.
    pub fn start_in(role: &str, topic: &Topic, variables: &[(&str, &str)]) -> Helper {
        let mut child = this_program()
            .args(["--exact", "child", "--nocapture", "--test-threads=1"])
            .env(ROLE, role)
            .env(TOPIC, topic.name())
            .envs(variables.iter().copied())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        let mut helper = Helper { child, lines };
        let mut line = String::new();
        while line.trim() != "ready" {
            line.clear();
            assert_ne!(
                helper.lines.read_line(&mut line).unwrap(),
                0,
                "the helper ended"
            );
        }
        helper
    }

    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// SIGKILL. The helper must have been running.
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

/// A segment seen as bytes, through a mapping of its own.
pub struct Raw {
    base: *mut u8,
    len: usize,
    _file: File,
}

// SAFETY: the mapping lives as long as the value and is touched by atomics alone.
unsafe impl Send for Raw {}
// SAFETY: as above.
unsafe impl Sync for Raw {}

impl Raw {
    pub fn open(topic: &Topic) -> io::Result<Raw> {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(topic.path())?;
        let len = file.metadata()?.len() as usize;
        let (protection, fd) = (libc::PROT_READ | libc::PROT_WRITE, file.as_raw_fd());
        // SAFETY: a new mapping at an address of the kernel's choice.
        let base =
            unsafe { libc::mmap(ptr::null_mut(), len, protection, libc::MAP_SHARED, fd, 0) };
        assert_ne!(base, libc::MAP_FAILED);
        Ok(Raw {
            base: base.cast(),
            len,
            _file: file,
        })
    }

    pub fn u32(&self, at: usize) -> &AtomicU32 {
        assert!(at.is_multiple_of(4) && at + 4 <= self.len);
        // SAFETY: aligned and inside the mapping, which lives as long as self.
        unsafe { AtomicU32::from_ptr(self.base.wrapping_add(at).cast()) }
    }

    pub fn u64(&self, at: usize) -> &AtomicU64 {
        assert!(at.is_multiple_of(8) && at + 8 <= self.len);
        // SAFETY: as above.
        unsafe { AtomicU64::from_ptr(self.base.wrapping_add(at).cast()) }
    }

    pub fn write(&self, at: usize, bytes: &[u8]) {
        assert!(at + bytes.len() <= self.len);
        // SAFETY: inside the mapping. Plain stores, as a legacy peer makes them.
        unsafe {
            ptr::copy_nonoverlapping(bytes.as_ptr(), self.base.wrapping_add(at), bytes.len())
        };
    }

    pub fn read(&self, at: usize, len: usize) -> Vec<u8> {
        assert!(at + len <= self.len);
        let mut bytes = vec![0; len];
        // SAFETY: inside the mapping. Plain loads, as a legacy peer makes them.
        unsafe { ptr::copy_nonoverlapping(self.base.wrapping_add(at), bytes.as_mut_ptr(), len) };
        bytes
    }

    pub fn futex_wake(&self) {
        // SAFETY: the word outlives the call.
        unsafe {
            libc::syscall(
                libc::SYS_futex,
                self.u32(132).as_ptr(),
                libc::FUTEX_WAKE,
                i32::MAX,
            )
        };
    }

    pub fn futex_wait(&self, expected: u32) {
        let no_timeout = ptr::null::<libc::timespec>();
        // SAFETY: the word outlives the call.
        unsafe {
            libc::syscall(
                libc::SYS_futex,
                self.u32(132).as_ptr(),
                libc::FUTEX_WAIT,
                expected,
                no_timeout,
            )
        };
    }
}

impl Drop for Raw {
    fn drop(&mut self) {
        // SAFETY: mapped in open, unmapped only here.
        unsafe { libc::munmap(self.base.cast(), self.len) };
    }
}
