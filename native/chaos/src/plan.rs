//! Which topics there are, who publishes them and who reads them.

use std::time::Duration;

use conduit_ring::{Error, Geometry};

/// How a publisher or a reader behaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manner {
    /// Opens once and goes on until it is killed.
    Steady,
    /// Opens and closes again and again; a publisher changes the geometry, too.
    Restless,
    /// Reads on and on, and holds each message in its slot for a while.
    Leasing,
}

/// Who publishes a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A native process.
    Native(Manner),
    /// The BEAM node of this number.
    Node(usize),
}

/// One topic.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// What its name ends with.
    pub label: &'static str,
    /// Number of slots.
    pub slot_count: u32,
    /// Bytes of a slot, its header included.
    pub slot_size: u32,
    /// Messages in one go, at most.
    pub burst: u64,
    /// The longest pause between two goes.
    pub pause: Duration,
    /// Who publishes it.
    pub source: Source,
    /// Native processes that read it on and on.
    pub readers: usize,
    /// Native processes that subscribe and leave again and again.
    pub restless_readers: usize,
    /// Native processes that hold messages in their slots.
    pub leasing_readers: usize,
    /// Whether BEAM nodes read it.
    pub nodes_read: bool,
}

/// A message of more bytes takes long enough to write that a kill can be aimed at it.
pub const LONG_MESSAGE: usize = 100_000;

/// BEAM nodes in a run that has any.
pub const NODES: usize = 2;

const NATIVE: Source = Source::Native(Manner::Steady);

/// All topics. A topic's place here is its number.
pub const LINES: [Line; 8] = [
    line("small", 16, 64, 40, 20, NATIVE, 2, 2, 1, true),
    line("page", 8, 4096, 20, 20, NATIVE, 2, 1, 0, true),
    line("two", 2, 1088, 30, 20, NATIVE, 2, 0, 2, false),
    line("one", 1, 512, 10, 20, NATIVE, 2, 0, 0, false),
    line("frame", 4, 2_100_032, 3, 120, NATIVE, 2, 0, 2, true),
    line(
        "restless",
        4,
        256,
        20,
        10,
        Source::Native(Manner::Restless),
        2,
        1,
        1,
        true,
    ),
    line("beam", 16, 4096, 20, 20, Source::Node(0), 2, 0, 0, true),
    line("dirty", 4, 300_032, 4, 60, Source::Node(1), 2, 0, 0, true),
];

#[expect(clippy::too_many_arguments, reason = "a row of the table above")]
const fn line(
    label: &'static str,
    slot_count: u32,
    slot_size: u32,
    burst: u64,
    pause_ms: u64,
    source: Source,
    readers: usize,
    restless_readers: usize,
    leasing_readers: usize,
    nodes_read: bool,
) -> Line {
    Line {
        label,
        slot_count,
        slot_size,
        burst,
        pause: Duration::from_millis(pause_ms),
        source,
        readers,
        restless_readers,
        leasing_readers,
        nodes_read,
    }
}

impl Line {
    /// The slots, or twice as many for every second segment of a restless publisher.
    pub fn geometry(&self, round: u64) -> Result<Geometry, Error> {
        Geometry::slots(self.slot_count << (round & 1), self.slot_size)
    }
}

/// One process, as it is started again after each of its deaths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A native publisher of a topic.
    Publisher(usize),
    /// A native reader of a topic.
    Reader(usize, Manner),
    /// A BEAM node, which publishes a topic and reads others.
    Node(usize),
}

impl Role {
    /// All processes of a run.
    pub fn all(with_nodes: bool) -> Vec<Role> {
        let mut roles = Vec::new();
        for (topic, line) in topics(with_nodes) {
            if let Source::Native(_) = line.source {
                roles.push(Role::Publisher(topic));
            }
            roles.extend((0..line.readers).map(|_| Role::Reader(topic, Manner::Steady)));
            roles.extend((0..line.restless_readers).map(|_| Role::Reader(topic, Manner::Restless)));
            roles.extend((0..line.leasing_readers).map(|_| Role::Reader(topic, Manner::Leasing)));
        }
        if with_nodes {
            roles.extend((0..NODES).map(Role::Node));
        }
        roles
    }

    /// Whether it writes this topic.
    pub fn publishes(self, topic: usize) -> bool {
        match self {
            Role::Publisher(own) => own == topic,
            Role::Reader(..) => false,
            Role::Node(node) => LINES[topic].source == Source::Node(node),
        }
    }

    /// Whether it reads this topic on and on.
    pub fn reads(self, topic: usize) -> bool {
        match self {
            Role::Publisher(_) => false,
            Role::Reader(own, manner) => own == topic && manner != Manner::Restless,
            Role::Node(_) => LINES[topic].nodes_read,
        }
    }

    /// Whether each of its readers goes on where it was, as long as it lives.
    pub fn in_order(self) -> bool {
        !matches!(self, Role::Reader(_, Manner::Restless))
    }

    /// Whether it is a BEAM node.
    pub fn is_node(self) -> bool {
        matches!(self, Role::Node(_))
    }
}

/// The topics of a run, with their numbers.
pub fn topics(with_nodes: bool) -> impl Iterator<Item = (usize, Line)> {
    let there = move |line: &Line| with_nodes || matches!(line.source, Source::Native(_));
    LINES
        .into_iter()
        .enumerate()
        .filter(move |(_, line)| there(line))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_topic_has_one_publisher_and_no_more_readers_than_places() {
        for (topic, line) in topics(true) {
            let roles = Role::all(true);
            let publishers = roles.iter().filter(|role| role.publishes(topic)).count();
            let readers = roles.iter().filter(|role| role.reads(topic)).count();
            assert_eq!(publishers, 1, "{}", line.label);
            assert!(
                readers + line.restless_readers < 16 && readers >= 2,
                "{}",
                line.label
            );
        }
    }

    #[test]
    fn without_nodes_every_topic_still_has_its_publisher() {
        let roles = Role::all(false);
        assert!(topics(false).all(|(topic, _)| roles.iter().any(|role| role.publishes(topic))));
        assert!(!roles.iter().any(|role| role.is_node()));
    }
}
