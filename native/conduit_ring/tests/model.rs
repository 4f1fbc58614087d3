//! The ring beside a model of it that is a list of messages.
#![cfg(not(loom))]

mod support;

use conduit_ring::{
    Geometry, Policy, PublishError, Publisher, PublisherOptions, Read, Start, Subscriber,
    SubscriberOptions,
};
use proptest::prelude::*;
use support::Scratch;

#[derive(Clone, Debug)]
enum Step {
    Publish(Vec<Vec<u8>>),
    Subscribe(SubscriberOptions),
    Read(usize),
    Leave(usize),
    Succeed,
}

struct ModelReader {
    cursor: usize,
    policy: Policy,
}

/// Every message ever published, and who has got how far.
struct Model {
    slots: usize,
    messages: Vec<Vec<u8>>,
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
        let oldest = self.messages.len().saturating_sub(keep).max(reader.cursor);
        let message = self.messages.get(oldest)?;
        let lost = oldest - reader.cursor;
        reader.cursor = oldest + 1;
        Some((oldest as u64, lost as u64, message))
    }
}

fn step() -> impl Strategy<Value = Step> {
    let parts = prop::collection::vec(prop::collection::vec(any::<u8>(), 0..80), 0..4);
    let start = prop_oneof![
        Just(Start::New),
        Just(Start::Latest),
        (0..20_u32).prop_map(Start::History)
    ];
    let policy = prop_oneof![3 => Just(Policy::All), 1 => Just(Policy::Latest)];
    let subscribe = (start, policy)
        .prop_map(|(start, policy)| Step::Subscribe(SubscriberOptions { start, policy }));
    prop_oneof![
        8 => parts.prop_map(Step::Publish),
        1 => subscribe,
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
    };
    let mut readers: Vec<(Subscriber, ModelReader)> = Vec::new();
    let mut buffer = Vec::new();
    let mut rejected = 0;
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
                } else {
                    prop_assert_eq!(result, Ok(model.messages.len() as u64));
                    model.messages.push(message);
                }
            }
            Step::Subscribe(options) if readers.len() < 16 => {
                readers.push((
                    Subscriber::open(&topic, &options).unwrap(),
                    model.subscribe(options),
                ));
            }
            Step::Subscribe(options) => prop_assert!(Subscriber::open(&topic, &options).is_err()),
            Step::Read(_) | Step::Leave(_) if readers.is_empty() => {}
            Step::Succeed => {
                publisher.abandon();
                publisher = Publisher::open(&topic, &options).unwrap();
                epoch += 1;
            }
            Step::Leave(who) => drop(readers.swap_remove(who % readers.len())),
            Step::Read(who) => {
                let who = who % readers.len();
                let (subscriber, reader) = &mut readers[who];
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
    let info = publisher.info();
    prop_assert_eq!(info.epoch, epoch);
    prop_assert_eq!(
        (info.published, info.rejected_oversize),
        (model.messages.len() as u64, rejected)
    );
    prop_assert_eq!((info.readers.len(), info.wake_count), (readers.len(), 0));
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
