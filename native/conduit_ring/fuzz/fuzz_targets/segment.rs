//! A segment whose bytes a hostile peer chooses, before and while others use it. The result is an
//! error or no data: never a crash, a hang or a byte out of bounds.
//!
//! An input is a script. Its first byte chooses the slots. The second byte says how many steps
//! come before a reader or publisher opens the file. Then each step takes eleven bytes: an
//! action, a place (u16) and a value (u64). The file is never shortened while it is mapped: the
//! kernel answers that with SIGBUS, which the protocol cannot prevent.
#![no_main]

use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::time::Duration;

use conduit_ring::{
    Error, Geometry, Guard, Info, Lease, Policy, Publisher, PublisherOptions, Read, Received,
    Start, Subscriber, SubscriberOptions, Topic,
};
use libfuzzer_sys::fuzz_target;

const HEADER: usize = 1216;
const STEP: usize = 11;
const STEPS: usize = 200;

fuzz_target!(|script: &[u8]| {
    let [slots, before, steps @ ..] = script else {
        return;
    };
    // The second geometry ends with a page, so that a byte beyond it is beyond the mapping.
    let geometry = if slots & 1 == 0 {
        Geometry::slots(4, 64)
    } else {
        Geometry::slots(1, 2880)
    };
    let mut scene = Scene::new(geometry.unwrap(), slots >> 1);
    let (steps, _) = steps.as_chunks::<STEP>();
    for (n, step) in steps.iter().take(STEPS).enumerate() {
        let at = usize::from(u16::from_le_bytes([step[1], step[2]]));
        let value = u64::from_le_bytes(std::array::from_fn(|i| step[3 + i]));
        if n < usize::from(*before) {
            scene.change(step[0], at, value);
        } else {
            scene.run_step(step[0], at, value);
        }
    }
    scene.end();
});

struct Scene {
    topic: Topic,
    file: File,
    geometry: Geometry,
    len: usize,
    subscribers: Vec<Subscriber>,
    leases: Vec<Lease>,
    publisher: Option<Publisher>,
}

impl Scene {
    /// Makes a sound segment with some messages in it, whose publisher has died.
    fn new(geometry: Geometry, messages: u8) -> Scene {
        let topic = Topic::new(&format!("fuzz-{}", std::process::id())).unwrap();
        let _ = std::fs::remove_file(topic.path());
        let mut publisher = Publisher::open(&topic, &options(geometry)).unwrap();
        for n in 0..messages {
            publisher.publish(&[n; 40]).unwrap();
        }
        publisher.abandon();
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(topic.path())
            .unwrap();
        let len = file.metadata().unwrap().len() as usize;
        Scene {
            topic,
            file,
            geometry,
            len,
            subscribers: Vec::new(),
            leases: Vec::new(),
            publisher: None,
        }
    }

    /// Changes the file as any process may that can write it.
    fn change(&self, kind: u8, at: usize, value: u64) {
        let bytes = value.to_le_bytes();
        match kind % 4 {
            0 => self.write(at % HEADER / 8 * 8, &bytes),
            1 => self.write(at % HEADER / 4 * 4, &bytes[..4]),
            2 => self.write(HEADER + at % (self.len - HEADER), &bytes),
            _ => self.seal(),
        }
    }

    fn run_step(&mut self, kind: u8, at: usize, value: u64) {
        match kind % 16 {
            0 => self.read(at),
            1 => self.subscribe(at, value),
            2 => self.publish(value),
            3 => self.publisher = None,
            4 => {
                if let Some(publisher) = self.publisher.take() {
                    publisher.abandon();
                }
            }
            5 => self.inspect(),
            6 => {
                self.subscribers.pop();
            }
            7 => self.lease(at),
            8 => self.drop_lease(at),
            9 => self.loan(at, value),
            _ => self.change(kind, at, value),
        }
    }

    /// Writes, never beyond the end: a longer file is not the subject.
    fn write(&self, at: usize, bytes: &[u8]) {
        let room = self.len - at;
        let _ = self
            .file
            .write_all_at(&bytes[..bytes.len().min(room)], at as u64);
    }

    /// Stores the checksum that a sound file has.
    fn seal(&self) {
        let mut head = [0; 64];
        self.file.read_exact_at(&mut head, 0).unwrap();
        let mut crc = !0_u32;
        for byte in head[..16].iter().chain(&head[48..56]) {
            crc ^= u32::from(*byte);
            for _ in 0..8 {
                crc = crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 };
            }
        }
        self.write(60, &(!crc).to_le_bytes());
    }

    fn subscribe(&mut self, at: usize, value: u64) {
        let start = match at % 3 {
            0 => Start::New,
            1 => Start::Latest,
            _ => Start::History(value as u32),
        };
        let policy = if at & 16 == 0 {
            Policy::All
        } else {
            Policy::Latest
        };
        let guard = if at & 32 == 0 {
            Guard::Never
        } else {
            Guard::Always
        };
        let options = SubscriberOptions {
            start,
            policy,
            guard,
        };
        match Subscriber::open(&self.topic, &options) {
            Ok(subscriber) => self.subscribers.push(subscriber),
            Err(error) => assert_documented(&error),
        }
    }

    fn lease(&mut self, at: usize) {
        let count = self.subscribers.len().max(1);
        let Some(subscriber) = self.subscribers.get_mut(at % count) else {
            return;
        };
        match subscriber.try_lease() {
            Ok(Received::Message(meta, lease)) => {
                assert!(meta.len == lease.len() && meta.len <= self.len);
                self.leases.push(lease);
            }
            Ok(_) => {}
            Err(error) => assert_documented(&error),
        }
    }

    /// Drops a lease, after reading it to its end: its bytes stay readable, whatever the file
    /// holds.
    fn drop_lease(&mut self, at: usize) {
        if self.leases.is_empty() {
            return;
        }
        let mut lease = self.leases.swap_remove(at % self.leases.len());
        assert!(lease.to_vec().len() == lease.len());
        if at & 256 != 0 {
            if let Err(error) = lease.detach() {
                assert_documented(&error);
            }
            assert!(lease.to_vec().len() == lease.len());
        }
    }

    fn loan(&mut self, at: usize, value: u64) {
        let bytes = value.to_le_bytes();
        let Some(Ok(mut loan)) = self.publisher.as_mut().map(|p| p.loan(bytes.len())) else {
            return;
        };
        loan.write_at(0, &bytes);
        if at & 1 == 0 {
            loan.commit();
        }
    }

    fn read(&mut self, at: usize) {
        let count = self.subscribers.len().max(1);
        let Some(subscriber) = self.subscribers.get_mut(at % count) else {
            return;
        };
        let mut buffer = Vec::new();
        match subscriber.try_read(&mut buffer) {
            Ok(Read::Message(meta)) => assert!(meta.len == buffer.len() && meta.len <= self.len),
            Ok(_) => {}
            Err(error) => assert_documented(&error),
        }
        if let Err(error) = subscriber.wait(Duration::ZERO) {
            assert_documented(&error);
        }
    }

    fn publish(&mut self, value: u64) {
        if self.publisher.is_none() {
            match Publisher::open(&self.topic, &options(self.geometry)) {
                Ok(publisher) => self.publisher = Some(publisher),
                Err(error) => return assert_documented(&error),
            }
        }
        if let Some(publisher) = &mut self.publisher {
            let _ = publisher.publish(&value.to_le_bytes());
        }
    }

    fn inspect(&self) {
        if let Err(error) = Info::read(&self.topic) {
            assert_documented(&error);
        }
    }

    /// Checks that the next publisher makes an unused file sound, whatever it holds.
    fn end(self) {
        let Scene {
            topic,
            file,
            geometry,
            subscribers,
            leases,
            publisher,
            ..
        } = self;
        drop((file, leases, subscribers, publisher));
        let mut publisher = Publisher::open(&topic, &options(geometry)).unwrap();
        let latest = SubscriberOptions {
            start: Start::Latest,
            ..SubscriberOptions::default()
        };
        publisher.publish(b"sound again").unwrap();
        // A broken file may have no free reader slot, until a person's tool repairs it.
        if let Ok(mut subscriber) = Subscriber::open(&topic, &latest) {
            let mut buffer = Vec::new();
            let _ = subscriber.try_read(&mut buffer);
        }
    }
}

fn options(geometry: Geometry) -> PublisherOptions {
    PublisherOptions {
        geometry,
        ..PublisherOptions::default()
    }
}

fn assert_documented(error: &Error) {
    let documented = matches!(
        error,
        Error::BadSegment { .. }
            | Error::NoReaderSlot { .. }
            | Error::TooManyLeases { .. }
            | Error::NoTopic { .. }
            | Error::PublisherAlive { .. }
            | Error::LegacyInUse { .. }
            | Error::Os { .. }
    );
    assert!(documented, "{error}");
}
