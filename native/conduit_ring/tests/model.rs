//! The ring beside a model of it that is a list of messages.
#![cfg(not(loom))]

mod support;

use std::collections::BTreeSet;

use conduit_ring::{
    Error, Geometry, Guard, Lease, Policy, PublishError, Publisher, PublisherOptions, Read,
    Received, Start, Subscriber, SubscriberOptions,
};
use proptest::prelude::*;
use support::Scratch;

#[derive(Clone, Debug)]
enum Step {
    Publish(Vec<Vec<u8>>),
    Loan(Vec<u8>, bool),
    Subscribe(SubscriberOptions),
    Read(usize),
    Lease(usize),
    EndLeases(usize),
    Leave(usize),
    Succeed,
}

#[derive(Clone)]
struct ModelReader {
    cursor: usize,
    policy: Policy,
}

/// Every number ever used, and the place of each reader.
struct Model {
    slots: usize,
    /// `None` where a held slot was passed over.
    messages: Vec<Option<Vec<u8>>>,
    /// Whether the next message was begun and not finished: the oldest message is lost then.
    begun: bool,
}

impl Model {
    fn subscribe(&self, options: SubscriberOptions) -> ModelReader {
        let published = self.messages.len();
        let oldest = published.saturating_sub(self.slots);
        let cursor = match options.start {
            Start::New => published,
            Start::Latest => self.newest(oldest).unwrap_or(oldest),
            Start::History(k) => published.saturating_sub(k as usize).max(oldest),
        };
        ModelReader {
            cursor,
            policy: options.policy,
        }
    }

    fn newest(&self, oldest: usize) -> Option<usize> {
        let is_message = |&n: &usize| self.messages[n].is_some();
        (oldest..self.messages.len()).rev().find(is_message)
    }

    /// Number, loss and content of the reader's next message.
    fn read(&self, reader: &mut ModelReader) -> Option<(u64, u64, &[u8])> {
        let keep = self.slots - usize::from(self.begun);
        let oldest = self.messages.len().saturating_sub(keep).max(reader.cursor);
        let is_message = |&n: &usize| self.messages[n].is_some();
        let next = match reader.policy {
            Policy::All => (oldest..self.messages.len()).find(is_message),
            Policy::Latest => self.newest(oldest),
        }?;
        let lost = next - reader.cursor;
        reader.cursor = next + 1;
        Some((next as u64, lost as u64, self.messages[next].as_ref()?))
    }
}

/// A subscriber with its leases. A guarded one does not show among the readers.
type LeasingReader = (Subscriber, ModelReader, Vec<Lease>, bool);

impl Model {
    /// Passes over the numbers whose slots are held and returns how many; `Err` when all are
    /// held.
    fn pass_over(&mut self, readers: &[LeasingReader]) -> Result<u64, ()> {
        let leases = readers.iter().flat_map(|reader| &reader.2);
        let held: BTreeSet<usize> = leases
            .filter(|lease| lease.holds_slot())
            .map(|lease| lease.meta().sequence as usize % self.slots)
            .collect();
        if held.len() == self.slots {
            return Err(());
        }
        let mut passed = 0;
        while held.contains(&(self.messages.len() % self.slots)) {
            self.messages.push(None);
            passed += 1;
        }
        Ok(passed)
    }

    fn push(&mut self, message: Vec<u8>) {
        self.messages.push(Some(message));
        self.begun = false;
    }
}

fn step() -> impl Strategy<Value = Step> {
    let parts = prop::collection::vec(prop::collection::vec(any::<u8>(), 0..80), 0..4);
    let start = prop_oneof![
        Just(Start::New),
        Just(Start::Latest),
        (0..20_u32).prop_map(Start::History)
    ];
    let guard = prop_oneof![3 => Just(Guard::Never), 1 => Just(Guard::Always)];
    let policy = prop_oneof![3 => Just(Policy::All), 1 => Just(Policy::Latest)];
    let subscribe = (start, policy, guard).prop_map(|(start, policy, guard)| {
        Step::Subscribe(SubscriberOptions {
            start,
            policy,
            guard,
        })
    });
    prop_oneof![
        8 => parts.prop_map(Step::Publish),
        2 => (prop::collection::vec(any::<u8>(), 0..40), any::<bool>())
            .prop_map(|(bytes, commit)| Step::Loan(bytes, commit)),
        1 => subscribe,
        4 => any::<usize>().prop_map(Step::Lease),
        2 => any::<usize>().prop_map(Step::EndLeases),
        8 => any::<usize>().prop_map(Step::Read),
        1 => any::<usize>().prop_map(Step::Leave),
        1 => Just(Step::Succeed),
    ]
}

fn run(geometry: Geometry, steps: Vec<Step>) -> Result<(), TestCaseError> {
    let topic = Scratch::new();
    let options = PublisherOptions {
        geometry,
        ..Default::default()
    };
    let mut publisher = Publisher::open(&topic, &options).unwrap();
    let mut model = Model {
        slots: geometry.slot_count() as usize,
        messages: Vec::new(),
        begun: false,
    };
    let mut readers: Vec<LeasingReader> = Vec::new();
    let mut buffer = Vec::new();
    let (mut rejected, mut dropped) = (0, 0);
    let mut epoch = 0;
    for step in steps {
        match step {
            Step::Publish(parts) => {
                let slices: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
                let (message, max) = (parts.concat(), geometry.max_message_size());
                let result = publisher.publish_slices(&slices);
                if message.len() > max {
                    prop_assert_eq!(
                        result,
                        Err(PublishError::TooLarge {
                            len: message.len(),
                            max
                        })
                    );
                    rejected += 1;
                } else if let Ok(passed) = model.pass_over(&readers) {
                    dropped += passed;
                    prop_assert_eq!(result, Ok(model.messages.len() as u64));
                    model.push(message);
                } else {
                    prop_assert_eq!(result, Err(PublishError::SlotHeld));
                    dropped += 1;
                }
            }
            Step::Loan(message, commit) => {
                match (publisher.loan(message.len()), model.pass_over(&readers)) {
                    (Ok(mut loan), Ok(passed)) => {
                        dropped += passed;
                        let (left, right) = message.split_at(message.len() / 2);
                        loan.write_at(left.len(), right);
                        loan.write_at(0, left);
                        model.begun = true;
                        if commit {
                            prop_assert_eq!(loan.commit(), model.messages.len() as u64);
                            model.push(message);
                        }
                    }
                    (Err(error), Err(())) => {
                        prop_assert_eq!(error, PublishError::SlotHeld);
                        dropped += 1;
                    }
                    (loan, expected) => {
                        prop_assert!(false, "{:?} instead of {:?}", loan, expected);
                    }
                }
            }
            Step::Subscribe(options) if readers.len() < 16 => {
                readers.push((
                    Subscriber::open(&topic, &options).unwrap(),
                    model.subscribe(options),
                    Vec::new(),
                    options.guard == Guard::Always,
                ));
            }
            Step::Subscribe(options) => prop_assert!(Subscriber::open(&topic, &options).is_err()),
            Step::Read(_) | Step::Leave(_) | Step::Lease(_) | Step::EndLeases(_)
                if readers.is_empty() => {}
            Step::Succeed => {
                publisher.abandon();
                publisher = Publisher::open(&topic, &options).unwrap();
                epoch += 1;
            }
            Step::Leave(index) => drop(readers.swap_remove(index % readers.len())),
            Step::EndLeases(index) => {
                if let Some((_, _, leases, _)) = readers.get_mut(index % 3) {
                    leases.clear();
                }
            }
            Step::Lease(index) => {
                let index = index % readers.len();
                let (subscriber, reader, leases, _) = &mut readers[index];
                let unread = model.read(&mut reader.clone()).is_some();
                let held = leases.iter().filter(|lease| lease.holds_slot()).count();
                if held == 3 {
                    // A passed-over number is no message, but only a pin finds that out.
                    let refused =
                        matches!(subscriber.try_lease(), Err(Error::TooManyLeases { .. }));
                    prop_assert!(refused || !unread);
                    continue;
                }
                match (subscriber.try_lease().unwrap(), model.read(reader)) {
                    (Received::Nothing, None) => {}
                    (Received::Message(meta, lease), Some((sequence, lost, message))) => {
                        prop_assert_eq!((meta.sequence, meta.lost), (sequence, lost));
                        prop_assert_eq!(&lease.to_vec()[..], message);
                        leases.push(lease);
                    }
                    (read, expected) => prop_assert!(false, "{read:?} instead of {expected:?}"),
                }
            }
            Step::Read(index) => {
                let index = index % readers.len();
                let (subscriber, reader, ..) = &mut readers[index];
                match (
                    subscriber.try_read(&mut buffer).unwrap(),
                    model.read(reader),
                ) {
                    (Read::Nothing, None) => {}
                    (Read::Message(meta), Some((sequence, lost, message))) => {
                        prop_assert_eq!((meta.sequence, meta.lost), (sequence, lost));
                        prop_assert_eq!((meta.len, &buffer[..]), (message.len(), message));
                    }
                    (read, expected) => prop_assert!(false, "{read:?} instead of {expected:?}"),
                }
            }
        }
    }
    for lease in readers.iter().flat_map(|reader| &reader.2) {
        let published = &model.messages[lease.meta().sequence as usize];
        prop_assert_eq!(Some(&lease.to_vec()), published.as_ref());
    }
    let info = publisher.info();
    prop_assert_eq!(info.dropped_pinned, dropped);
    prop_assert_eq!(info.epoch, epoch);
    prop_assert_eq!(
        (info.published, info.rejected_oversize),
        (model.messages.len() as u64, rejected)
    );
    let shown = readers.iter().filter(|reader| !reader.3).count();
    prop_assert_eq!((info.readers.len(), info.wake_count), (shown, 0));
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300, failure_persistence: None, ..Default::default()
    })]

    #[test]
    fn the_ring_does_what_a_list_of_messages_does(
        slots in 0..4_u32,
        slot_size in prop_oneof![Just(64_u32), Just(128), Just(192)],
        steps in prop::collection::vec(step(), 1..200),
    ) {
        run(Geometry::slots(1 << slots, slot_size).unwrap(), steps)?;
    }
}
