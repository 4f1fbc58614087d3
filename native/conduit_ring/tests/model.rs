//! The ring beside a model of it that is a list of messages.
#![cfg(not(loom))]

mod support;

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

/// Every message ever published, and who has got how far.
struct Model {
    slots: usize,
    messages: Vec<Vec<u8>>,
    /// Whether the next message was begun and not finished, which cost the oldest one.
    begun: bool,
}

impl Model {
    fn subscribe(&self, options: SubscriberOptions) -> ModelReader {
        let back = match options.start {
            Start::New => 0,
            Start::Latest => 1,
            Start::History(k) => (k as usize).min(self.slots),
        };
        ModelReader {
            cursor: self.messages.len().saturating_sub(back),
            policy: options.policy,
        }
    }

    /// Number, loss and content of the reader's next message.
    fn read(&self, reader: &mut ModelReader) -> Option<(u64, u64, &[u8])> {
        let keep = match reader.policy {
            Policy::All => self.slots,
            Policy::Latest => 1,
        };
        let keep = keep.min(self.slots - usize::from(self.begun));
        let oldest = self.messages.len().saturating_sub(keep).max(reader.cursor);
        let message = self.messages.get(oldest)?;
        let lost = oldest - reader.cursor;
        reader.cursor = oldest + 1;
        Some((oldest as u64, lost as u64, message))
    }
}

/// With its leases, and whether it is guarded and so does not show.
type LeasingReader = (Subscriber, ModelReader, Vec<Lease>, bool);

impl Model {
    /// Whether some lease holds the slot of the next message.
    fn is_held(&self, readers: &[LeasingReader]) -> bool {
        let held = |lease: &Lease| {
            lease.holds_slot() && lease.meta().sequence as usize + self.slots == self.messages.len()
        };
        readers.iter().flat_map(|reader| &reader.2).any(held)
    }

    fn push(&mut self, message: Vec<u8>) {
        self.messages.push(message);
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
        2 => (prop::collection::vec(any::<u8>(), 0..40), any::<bool>()).prop_map(|(bytes, commit)| Step::Loan(bytes, commit)),
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
                } else if model.is_held(&readers) {
                    prop_assert_eq!(result, Err(PublishError::SlotHeld));
                    dropped += 1;
                } else {
                    prop_assert_eq!(result, Ok(model.messages.len() as u64));
                    model.push(message);
                }
            }
            Step::Loan(message, commit) => match publisher.loan(message.len()) {
                Ok(mut loan) => {
                    prop_assert!(!model.is_held(&readers));
                    let (left, right) = message.split_at(message.len() / 2);
                    loan.write_at(left.len(), right);
                    loan.write_at(0, left);
                    model.begun = true;
                    if commit {
                        prop_assert_eq!(loan.commit(), model.messages.len() as u64);
                        model.push(message);
                    }
                }
                Err(error) => {
                    prop_assert_eq!(error, PublishError::SlotHeld);
                    prop_assert!(model.is_held(&readers));
                    dropped += 1;
                }
            },
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
            Step::Leave(who) => drop(readers.swap_remove(who % readers.len())),
            Step::EndLeases(who) => {
                if let Some((_, _, leases, _)) = readers.get_mut(who % 3) {
                    leases.clear();
                }
            }
            Step::Lease(who) => {
                let who = who % readers.len();
                let (subscriber, reader, leases, _) = &mut readers[who];
                let unread = reader.cursor < model.messages.len();
                let held = leases.iter().filter(|lease| lease.holds_slot()).count();
                if held == 3 && unread {
                    let refused = subscriber.try_lease();
                    prop_assert!(
                        matches!(refused, Err(Error::TooManyLeases { .. })),
                        "{refused:?}"
                    );
                    continue;
                }
                match (subscriber.try_lease().unwrap(), model.read(reader)) {
                    (Received::Nothing, None) => {}
                    (Received::Message(meta, lease), Some((sequence, lost, message))) => {
                        prop_assert_eq!((meta.sequence, meta.lost), (sequence, lost));
                        prop_assert_eq!(&lease.to_vec()[..], message);
                        leases.push(lease);
                    }
                    (read, expected) => prop_assert!(false, "{:?} instead of {:?}", read, expected),
                }
            }
            Step::Read(who) => {
                let who = who % readers.len();
                let (subscriber, reader, ..) = &mut readers[who];
                match (
                    subscriber.try_read(&mut buffer).unwrap(),
                    model.read(reader),
                ) {
                    (Read::Nothing, None) => {}
                    (Read::Message(meta), Some((sequence, lost, message))) => {
                        prop_assert_eq!((meta.sequence, meta.lost), (sequence, lost));
                        prop_assert_eq!((meta.len, &buffer[..]), (message.len(), message));
                    }
                    (read, expected) => prop_assert!(false, "{:?} instead of {:?}", read, expected),
                }
            }
        }
    }
    for lease in readers.iter().flat_map(|reader| &reader.2) {
        let published = &model.messages[lease.meta().sequence as usize];
        prop_assert_eq!(&lease.to_vec(), published);
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
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..Default::default() })]

    #[test]
    fn the_ring_does_what_a_list_of_messages_does(
        slots in 0..4_u32,
        slot_size in prop_oneof![Just(64_u32), Just(128), Just(192)],
        steps in prop::collection::vec(step(), 1..200),
    ) {
        run(Geometry::slots(1 << slots, slot_size).unwrap(), steps)?;
    }
}
