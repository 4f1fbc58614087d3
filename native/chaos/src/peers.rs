//! What the native processes do that are killed.

use std::collections::VecDeque;
use std::path::Path;
use std::time::{Duration, Instant};

use conduit_ring::{
    Geometry, Meta, PublishError, Publisher, PublisherOptions, Read, Received, Start, Subscriber,
    SubscriberOptions, Topic,
};
use program::Failure;
use program::stop::Stop;

use crate::message::{self, HEADER, Identity};
use crate::plan::{LINES, LONG_MESSAGE, Manner, Source};
use crate::random::Random;
use crate::record::{Log, Record};

/// A restless reader stays this long at most.
const VISIT: Duration = Duration::from_millis(20);
/// A leasing reader holds a message this long at most when it has nothing else to do.
const HOLD: Duration = Duration::from_millis(3);
/// As many leases as a subscriber may have.
const LEASES: usize = 3;
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
        // The number that the message will have: behind the slots that readers hold, of which a loan passes over.
        match self.publisher.loan(0) {
            Ok(loan) => self.identity.sequence = loan.sequence(),
            Err(PublishError::SlotHeld) => return Ok(()),
            Err(error) => return Err(world(error)),
        }
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
        let published = if random.one_in(3) {
            self.lend(random, head, body)
        } else {
            self.publisher.publish_slices(&[head, body]).map(drop)
        };
        match published {
            Err(PublishError::SlotHeld) => Ok(()),
            published => published.map_err(world),
        }
    }

    /// Writes the message into its slot, and one time in eight leaves it there unpublished.
    fn lend(&mut self, random: &mut Random, head: &[u8], body: &[u8]) -> Result<(), PublishError> {
        let mut loan = self.publisher.loan(head.len() + body.len())?;
        loan.write_at(head.len(), body);
        if !random.one_in(8) {
            loan.write_at(0, head);
            loan.commit();
        }
        Ok(())
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
    while !stop.requested() {
        let subscriber = Subscriber::open(topic, &options(&mut random)).map_err(world)?;
        let reader = Reader {
            subscriber,
            topic: number as u32,
            log: &mut log,
            stop,
        };
        match manner {
            Manner::Steady => reader.read(None)?,
            Manner::Restless => reader.read(Some(Instant::now() + random.up_to(VISIT)))?,
            Manner::Leasing => reader.lease(&mut random)?,
        }
    }
    Ok(())
}

/// One subscription.
struct Reader<'a> {
    subscriber: Subscriber,
    topic: u32,
    log: &'a mut Log,
    stop: &'a Stop,
}

impl Reader<'_> {
    /// Reads until the deadline, or on and on.
    fn read(mut self, deadline: Option<Instant>) -> Result<(), Failure> {
        if deadline.is_none() {
            self.wake_on_stop();
        }
        let mut buffer = Vec::new();
        let timeout = deadline.map_or(Duration::MAX, |_| VISIT);
        while !self.stop.requested() && deadline.is_none_or(|deadline| Instant::now() < deadline) {
            let read = self.subscriber.read_timeout(&mut buffer, timeout);
            if let Read::Message(meta) = read.map_err(world)? {
                self.note(&meta, &buffer)?;
            }
        }
        Ok(())
    }

    /// Holds messages in their slots, up to three at once, and looks at each only when it is about to let go.
    fn lease(mut self, random: &mut Random) -> Result<(), Failure> {
        self.wake_on_stop();
        let mut held = VecDeque::new();
        while !self.stop.requested() {
            let most = random.below(LEASES as u64) as usize;
            match self.subscriber.try_lease().map_err(world)? {
                Received::Message(_, lease) => held.push_back(lease),
                Received::Nothing if held.is_empty() => {
                    self.subscriber.wait(Duration::MAX).map_err(world)?;
                }
                _ => {}
            }
            if held.len() > most
                && let Some(lease) = held.pop_front()
            {
                self.stop.wait_until(Instant::now() + random.up_to(HOLD));
                self.note(&lease.meta(), &lease.to_vec())?;
            }
        }
        Ok(())
    }

    fn wake_on_stop(&self) {
        let waker = self.subscriber.waker();
        self.stop.on_request(move || waker.wake());
    }

    fn note(&mut self, meta: &Meta, bytes: &[u8]) -> Result<(), Failure> {
        self.log
            .append(&Record::of(self.topic, meta, bytes))
            .map_err(world)
    }
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
    Failure::Runtime(error.to_string())
}
