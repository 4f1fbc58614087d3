//! The plan of a run: its topics, their publishers and readers.

use std::time::Duration;

use conduit_ring::{Error, Geometry};

/// The behaviour of a publisher or reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Behaviour {
    /// Opens the topic once and runs until it is killed.
    Steady,
    /// Opens and closes the topic repeatedly. A publisher changes the geometry too.
    Restless,
    /// Reads continuously and holds each message in its slot for a while.
    Leasing,
}

/// The publisher of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PublishedBy {
    /// A native process.
    Native(Behaviour),
    /// The BEAM node with this number.
    Node(usize),
}

/// The plan of a topic.
#[derive(Clone, Copy, Debug)]
pub struct TopicPlan {
    /// The end of the topic's name.
    pub label: &'static str,
    /// Number of slots.
    pub slot_count: u32,
    /// Size of a slot in bytes, including its header.
    pub slot_size: u32,
    /// The most messages without a pause.
    pub burst: u64,
    /// The longest pause between two bursts.
    pub pause: Duration,
    /// The publisher.
    pub published_by: PublishedBy,
    /// Number of native processes that read continuously.
    pub readers: usize,
    /// Number of native processes that subscribe and close repeatedly.
    pub restless_readers: usize,
    /// Number of native processes that hold messages in their slots.
    pub leasing_readers: usize,
    /// Whether BEAM nodes read the topic.
    pub nodes_read: bool,
}

/// The size in bytes from which writing a message takes long enough to aim a kill at it.
pub const LONG_MESSAGE: usize = 100_000;

/// Number of BEAM nodes in a run with nodes.
pub const NODES: usize = 2;

const NATIVE: PublishedBy = PublishedBy::Native(Behaviour::Steady);

/// All topics. A topic's index is its number.
pub const TOPICS: [TopicPlan; 8] = [
    topic("small", 16, 64, 40, 20, NATIVE, 2, 2, 1, true),
    topic("page", 8, 4096, 20, 20, NATIVE, 2, 1, 0, true),
    topic("two", 2, 1088, 30, 20, NATIVE, 2, 0, 2, false),
    topic("one", 1, 512, 10, 20, NATIVE, 2, 0, 0, false),
    topic("frame", 4, 2_100_032, 3, 120, NATIVE, 2, 0, 2, true),
    topic(
        "restless",
        4,
        256,
        20,
        10,
        PublishedBy::Native(Behaviour::Restless),
        2,
        1,
        1,
        true,
    ),
    topic(
        "beam",
        16,
        4096,
        20,
        20,
        PublishedBy::Node(0),
        2,
        0,
        0,
        true,
    ),
    topic(
        "dirty",
        4,
        300_032,
        4,
        60,
        PublishedBy::Node(1),
        2,
        0,
        0,
        true,
    ),
];

#[expect(clippy::too_many_arguments, reason = "a row of the table above")]
const fn topic(
    label: &'static str,
    slot_count: u32,
    slot_size: u32,
    burst: u64,
    pause_ms: u64,
    published_by: PublishedBy,
    readers: usize,
    restless_readers: usize,
    leasing_readers: usize,
    nodes_read: bool,
) -> TopicPlan {
    TopicPlan {
        label,
        slot_count,
        slot_size,
        burst,
        pause: Duration::from_millis(pause_ms),
        published_by,
        readers,
        restless_readers,
        leasing_readers,
        nodes_read,
    }
}

impl TopicPlan {
    /// Returns the geometry, with twice the slots in every second round of a restless publisher.
    pub fn geometry(&self, round: u64) -> Result<Geometry, Error> {
        Geometry::slots(self.slot_count << (round & 1), self.slot_size)
    }
}

/// The role of a process, which each of its lives has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A native publisher of a topic.
    Publisher(usize),
    /// A native reader of a topic.
    Reader(usize, Behaviour),
    /// A BEAM node that publishes a topic and reads others.
    Node(usize),
}

impl Role {
    /// Returns the roles of all processes of a run.
    pub fn all(with_nodes: bool) -> Vec<Role> {
        let mut roles = Vec::new();
        for (number, topic) in topics(with_nodes) {
            if let PublishedBy::Native(_) = topic.published_by {
                roles.push(Role::Publisher(number));
            }
            let readers = [
                (topic.readers, Behaviour::Steady),
                (topic.restless_readers, Behaviour::Restless),
                (topic.leasing_readers, Behaviour::Leasing),
            ];
            for (count, behaviour) in readers {
                roles.extend((0..count).map(|_| Role::Reader(number, behaviour)));
            }
        }
        if with_nodes {
            roles.extend((0..NODES).map(Role::Node));
        }
        roles
    }

    /// Returns whether the process publishes this topic.
    pub fn publishes(self, topic: usize) -> bool {
        match self {
            Role::Publisher(own) => own == topic,
            Role::Reader(..) => false,
            Role::Node(node) => TOPICS[topic].published_by == PublishedBy::Node(node),
        }
    }

    /// Returns whether the process reads this topic continuously.
    pub fn reads(self, topic: usize) -> bool {
        match self {
            Role::Publisher(_) => false,
            Role::Reader(own, behaviour) => own == topic && behaviour != Behaviour::Restless,
            Role::Node(_) => TOPICS[topic].nodes_read,
        }
    }

    /// Returns whether the process reads its topics in order during a life.
    pub fn in_order(self) -> bool {
        !matches!(self, Role::Reader(_, Behaviour::Restless))
    }

    /// Returns whether the process is a BEAM node.
    pub fn is_node(self) -> bool {
        matches!(self, Role::Node(_))
    }
}

/// Returns the topics of a run with their numbers.
pub fn topics(with_nodes: bool) -> impl Iterator<Item = (usize, TopicPlan)> {
    TOPICS.into_iter().enumerate().filter(move |(_, topic)| {
        with_nodes || matches!(topic.published_by, PublishedBy::Native(_))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_topic_has_one_publisher_and_no_more_readers_than_slots() {
        for (number, topic) in topics(true) {
            let roles = Role::all(true);
            let publishers = roles.iter().filter(|role| role.publishes(number)).count();
            let readers = roles.iter().filter(|role| role.reads(number)).count();
            assert_eq!(publishers, 1, "{}", topic.label);
            assert!(
                readers + topic.restless_readers < 16 && readers >= 2,
                "{}",
                topic.label
            );
        }
    }

    #[test]
    fn without_nodes_every_topic_still_has_its_publisher() {
        let roles = Role::all(false);
        assert!(topics(false).all(|(number, _)| roles.iter().any(|role| role.publishes(number))));
        assert!(!roles.iter().any(|role| role.is_node()));
    }
}
