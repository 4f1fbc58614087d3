//! The peer in Rust. See README.md.
//!
//! ```text
//! Usage: languages COUNT OWN OTHER...
//! ```

use std::error::Error;
use std::io::{self, Write};
use std::sync::{Condvar, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use conduit_ring::{
    Geometry, Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions, Topic,
};

const SLOTS: u32 = 64;
const WINDOW: u64 = 16;
const HEADER: usize = 20;
const LONGEST_BODY: u32 = 61_440;
/// The longest wait for a message, longer than any pause of a working peer.
const TIMEOUT: Duration = Duration::from_secs(60);

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [count, own, others @ ..] = &arguments[..] else {
        return Err("Usage: languages COUNT OWN OTHER...".into());
    };
    let count = count.parse()?;
    let own = Topic::new(own)?;
    let subscribers = others
        .iter()
        .map(|name| subscribe(name))
        .collect::<Result<Vec<_>>>()?;
    let options = PublisherOptions {
        geometry: Geometry::depth(SLOTS, LONGEST_BODY + HEADER as u32)?,
        ..PublisherOptions::default()
    };
    let mut publisher = Publisher::open(&own, &options)?;
    print_line("ready")?;
    await_line()?;
    let progress = Progress::new(subscribers.len());
    thread::scope(|scope| {
        for (index, subscriber) in subscribers.into_iter().enumerate() {
            let progress = &progress;
            scope.spawn(move || {
                if let Err(error) = read(subscriber, count, |n| progress.set(index, n)) {
                    eprintln!("rust: {error}");
                    std::process::exit(1);
                }
            });
        }
        publish(&mut publisher, count, &progress)
    })?;
    await_line()
}

fn subscribe(name: &str) -> Result<Subscriber> {
    let topic = Topic::new(name)?;
    Ok(Subscriber::open(&topic, &SubscriberOptions::default())?)
}

fn publish(publisher: &mut Publisher, count: u64, progress: &Progress) -> Result<()> {
    for n in 0..count {
        progress.await_all((n + 1).saturating_sub(WINDOW));
        publisher.publish(&message(publisher.topic(), n))?;
    }
    Ok(())
}

/// Reads all messages of a topic and reports their number after each one.
fn read(mut subscriber: Subscriber, count: u64, report: impl Fn(u64)) -> Result<()> {
    let topic = subscriber.topic().clone();
    let mut buffer = Vec::new();
    let (mut next, mut bytes) = (0, 0);
    while next < count {
        match subscriber.read_timeout(&mut buffer, TIMEOUT)? {
            Read::Message(meta) => {
                if meta.lost > 0 || meta.sequence != next || buffer != message(&topic, next) {
                    return Err(
                        format!("{topic:?}: expected message {next}, got: {meta:?}").into()
                    );
                }
                next += 1;
                bytes += buffer.len();
                report(next);
            }
            Read::PublisherUp => {}
            other => {
                return Err(format!("{topic:?}: expected message {next}, got: {other:?}").into());
            }
        }
    }
    print_line(&format!("verified {} {next} {bytes}", topic.name()))
}

/// Returns message `n` of a topic.
fn message(topic: &Topic, n: u64) -> Vec<u8> {
    let len = (n as u32).wrapping_mul(2_654_435_761) % (LONGEST_BODY + 1);
    let word = n.wrapping_mul(0x9E37_79B9_7F4A_7C15).to_le_bytes();
    let body = word.iter().copied().cycle().take(len as usize);
    let mut message = Vec::with_capacity(HEADER + len as usize);
    message.extend(n.to_le_bytes());
    message.extend(crc32fast::hash(topic.name().as_bytes()).to_le_bytes());
    message.extend(len.to_le_bytes());
    message.extend([0; 4]);
    message.extend(body);
    let mut checksum = crc32fast::Hasher::new();
    checksum.update(&message[..16]);
    checksum.update(&message[HEADER..]);
    message[16..HEADER].copy_from_slice(&checksum.finalize().to_le_bytes());
    message
}

/// The number of messages read from each topic.
struct Progress {
    read: Mutex<Vec<u64>>,
    changed: Condvar,
}

impl Progress {
    fn new(topics: usize) -> Progress {
        Progress {
            read: Mutex::new(vec![0; topics]),
            changed: Condvar::new(),
        }
    }

    fn set(&self, topic: usize, count: u64) {
        self.read.lock().unwrap_or_else(PoisonError::into_inner)[topic] = count;
        self.changed.notify_one();
    }

    fn await_all(&self, count: u64) {
        let read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        let behind = |read: &mut Vec<u64>| read.iter().any(|read| *read < count);
        drop(self.changed.wait_while(read, behind));
    }
}

fn print_line(line: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    Ok(out.flush()?)
}

fn await_line() -> Result<()> {
    io::stdin().read_line(&mut String::new())?;
    Ok(())
}
