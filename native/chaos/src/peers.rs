//! What the native processes do that are killed.

use std::path::Path;
use std::time::{Duration, Instant};

use conduit_ring::{
    Geometry, Publisher, PublisherOptions, Read, Start, Subscriber, SubscriberOptions, Topic,
};
use program::Failure;
use program::stop::Stop;

use crate::message::{self, HEADER, Identity};
use crate::plan::{LINES, LONG_MESSAGE, Manner, Source};
use crate::random::Random;
use crate::record::{Log, Record};

/// A restless reader stays this long at most.
const VISIT: Duration = Duration::from_millis(20);
/// A corrupt publisher spoils one message of so many.
const SPOILT: u64 = 20;

/// Publishes topic `number` of the plan under `topic` until it is killed or stopped.
pub fn publish(
    number: usize,
    topic: &Topic,
    seed: u64,
    corrupt: bool,
    stop: &Stop,
) -> Result<(), Failure> {
    let line = &LINES[number];
    let mut random = Random::new(seed);
    let mut buffer = Vec::new();
    for round in 0.. {
        let geometry = line.geometry(round).map_err(world)?;
        let mut life = Life::begin(number, topic, geometry, random.next())?;
        let bursts = match line.source {
            Source::Native(Manner::Restless) => random.below(8),
            _ => u64::MAX,
        };
        for _ in 0..bursts {
            for _ in 0..=random.below(line.burst) {
                let spoil = corrupt && random.one_in(SPOILT);
                life.publish(&mut random, &mut buffer, spoil)?;
            }
            if stop.wait_until(Instant::now() + random.up_to(line.pause)) {
                return Ok(());
            }
        }
        if random.one_in(4) {
            life.publisher.abandon();
        }
    }
    Ok(())
}

/// One opening of a topic.
struct Life {
    publisher: Publisher,
    identity: Identity,
    longest: usize,
}

impl Life {
    fn begin(
        number: usize,
        topic: &Topic,
        geometry: Geometry,
        writer: u64,
    ) -> Result<Life, Failure> {
        let options = PublisherOptions {
            geometry,
            ..PublisherOptions::default()
        };
        let publisher = Publisher::open(topic, &options).map_err(world)?;
        let identity = Identity {
            topic: number as u32,
            writer,
            instance: publisher.info().instance_id,
            sequence: 0,
        };
        Ok(Life {
            publisher,
            identity,
            longest: geometry.max_message_size(),
        })
    }

    fn publish(
        &mut self,
        random: &mut Random,
        buffer: &mut Vec<u8>,
        spoil: bool,
    ) -> Result<(), Failure> {
        self.identity.sequence = self.publisher.next_sequence();
        // Of long messages every other one has all the length there is, so that many a death is in the midst of one.
        let len = if self.longest > LONG_MESSAGE && random.one_in(2) {
            self.longest
        } else {
            random.length(HEADER, self.longest)
        };
        message::write(buffer, &self.identity, len);
        if spoil {
            let at = random.below(buffer.len() as u64) as usize;
            buffer[at] ^= 1;
        }
        let (head, body) = buffer.split_at(random.below(buffer.len() as u64 + 1) as usize);
        self.publisher
            .publish_slices(&[head, body])
            .map(drop)
            .map_err(world)
    }
}

/// Reads topic `number` of the plan from `topic`, and notes every message, until it is killed or stopped.
pub fn subscribe(
    number: usize,
    topic: &Topic,
    seed: u64,
    manner: Manner,
    log: &Path,
    stop: &Stop,
) -> Result<(), Failure> {
    let mut random = Random::new(seed);
    let mut log = Log::open(log).map_err(world)?;
    let mut buffer = Vec::new();
    while !stop.requested() {
        let mut subscriber = Subscriber::open(topic, &options(&mut random)).map_err(world)?;
        let deadline = match manner {
            Manner::Restless => Some(Instant::now() + random.up_to(VISIT)),
            Manner::Steady => {
                let waker = subscriber.waker();
                stop.wakes(move || waker.wake());
                None
            }
        };
        while !stop.requested() && deadline.is_none_or(|deadline| Instant::now() < deadline) {
            let timeout = deadline.map_or(Duration::MAX, |_| VISIT);
            let read = subscriber
                .read_timeout(&mut buffer, timeout)
                .map_err(world)?;
            if let Read::Message(meta) = read {
                log.append(&Record::of(number as u32, &meta, &buffer))
                    .map_err(world)?;
            }
        }
    }
    Ok(())
}

fn options(random: &mut Random) -> SubscriberOptions {
    let start = match random.below(3) {
        0 => Start::New,
        1 => Start::Latest,
        _ => Start::History(random.below(32) as u32 + 1),
    };
    SubscriberOptions {
        start,
        ..SubscriberOptions::default()
    }
}

fn world(error: impl std::fmt::Display) -> Failure {
    Failure::World(error.to_string())
}
