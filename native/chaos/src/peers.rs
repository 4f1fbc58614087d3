//! The native processes of a run, which it kills.

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
use crate::plan::{Behaviour, LONG_MESSAGE, PublishedBy, TOPICS};
use crate::random::Random;
use crate::record::{Log, Record};

/// The longest time for which a restless reader stays subscribed.
const VISIT: Duration = Duration::from_millis(20);
/// The longest time for which a leasing reader waits before it releases a message.
const HOLD: Duration = Duration::from_millis(3);
/// The most leases of a subscriber at the same time.
const LEASES: usize = 3;
/// A corrupting publisher corrupts one message in this many.
const CORRUPT_ONE_IN: u64 = 20;

/// Publishes the topic with this number in the plan until the process is killed or stopped.
pub fn publish(
    number: usize,
    topic: &Topic,
    seed: u64,
    corrupt: bool,
    stop: &Stop,
) -> Result<(), Failure> {
    let plan = &TOPICS[number];
    let mut random = Random::new(seed);
    let mut buffer = Vec::new();
    for round in 0.. {
        let geometry = plan.geometry(round).map_err(runtime)?;
        let mut life = Life::begin(number, topic, geometry, random.next())?;
        let bursts = match plan.published_by {
            PublishedBy::Native(Behaviour::Restless) => random.below(8),
            _ => u64::MAX,
        };
        for _ in 0..bursts {
            for _ in 0..=random.below(plan.burst) {
                let corrupt = corrupt && random.one_in(CORRUPT_ONE_IN);
                life.publish(&mut random, &mut buffer, corrupt)?;
            }
            if stop.wait_until(Instant::now() + random.up_to(plan.pause)) {
                return Ok(());
            }
        }
        if random.one_in(4) {
            life.publisher.abandon();
        }
    }
    Ok(())
}

/// A publisher of a topic from its opening to its close.
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
        let publisher = Publisher::open(topic, &options).map_err(runtime)?;
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
        corrupt: bool,
    ) -> Result<(), Failure> {
        // A loan skips the slots that readers hold, so its number is the message's.
        match self.publisher.loan(0) {
            Ok(loan) => self.identity.sequence = loan.sequence(),
            Err(PublishError::SlotHeld) => return Ok(()),
            Err(error) => return Err(runtime(error)),
        }
        // Half of the long messages have the largest size, so that many kills happen while one is
        // written.
        let len = if self.longest > LONG_MESSAGE && random.one_in(2) {
            self.longest
        } else {
            random.length(HEADER, self.longest)
        };
        message::write(buffer, &self.identity, len);
        if corrupt {
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
            published => published.map_err(runtime),
        }
    }

    /// Writes the message in its slot. Does not publish one message in eight.
    fn lend(
        &mut self,
        random: &mut Random,
        head: &[u8],
        body: &[u8],
    ) -> Result<(), PublishError> {
        let mut loan = self.publisher.loan(head.len() + body.len())?;
        loan.write_at(head.len(), body);
        if !random.one_in(8) {
            loan.write_at(0, head);
            loan.commit();
        }
        Ok(())
    }
}

/// Reads the topic with this number in the plan and records every message until the process is
/// killed or stopped.
pub fn subscribe(
    number: usize,
    topic: &Topic,
    seed: u64,
    behaviour: Behaviour,
    log: &Path,
    stop: &Stop,
) -> Result<(), Failure> {
    let mut random = Random::new(seed);
    let mut log = Log::open(log).map_err(runtime)?;
    while !stop.requested() {
        let subscriber = Subscriber::open(topic, &options(&mut random)).map_err(runtime)?;
        let reader = Reader {
            subscriber,
            topic: number as u32,
            log: &mut log,
            stop,
        };
        match behaviour {
            Behaviour::Steady => reader.read(None)?,
            Behaviour::Restless => reader.read(Some(Instant::now() + random.up_to(VISIT)))?,
            Behaviour::Leasing => reader.lease(&mut random)?,
        }
    }
    Ok(())
}

/// A subscription.
struct Reader<'a> {
    subscriber: Subscriber,
    topic: u32,
    log: &'a mut Log,
    stop: &'a Stop,
}

impl Reader<'_> {
    /// Reads until the deadline, or until the stop if there is none.
    fn read(mut self, deadline: Option<Instant>) -> Result<(), Failure> {
        if deadline.is_none() {
            self.wake_on_stop();
        }
        let mut buffer = Vec::new();
        let timeout = deadline.map_or(Duration::MAX, |_| VISIT);
        while !self.stop.requested() && deadline.is_none_or(|deadline| Instant::now() < deadline)
        {
            let read = self.subscriber.read_timeout(&mut buffer, timeout);
            if let Read::Message(meta) = read.map_err(runtime)? {
                self.record(&meta, &buffer)?;
            }
        }
        Ok(())
    }

    /// Holds up to [`LEASES`] messages in their slots and reads each one just before its
    /// release.
    fn lease(mut self, random: &mut Random) -> Result<(), Failure> {
        self.wake_on_stop();
        let mut held = VecDeque::new();
        while !self.stop.requested() {
            let most = random.below(LEASES as u64) as usize;
            match self.subscriber.try_lease().map_err(runtime)? {
                Received::Message(_, lease) => held.push_back(lease),
                Received::Nothing if held.is_empty() => {
                    self.subscriber.wait(Duration::MAX).map_err(runtime)?;
                }
                _ => {}
            }
            if held.len() > most
                && let Some(lease) = held.pop_front()
            {
                self.stop.wait_until(Instant::now() + random.up_to(HOLD));
                self.record(&lease.meta(), &lease.to_vec())?;
            }
        }
        Ok(())
    }

    fn wake_on_stop(&self) {
        let waker = self.subscriber.waker();
        self.stop.on_request(move || waker.wake());
    }

    fn record(&mut self, meta: &Meta, bytes: &[u8]) -> Result<(), Failure> {
        self.log
            .append(&Record::of(self.topic, meta, bytes))
            .map_err(runtime)
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

fn runtime(error: impl std::fmt::Display) -> Failure {
    Failure::Runtime(error.to_string())
}
