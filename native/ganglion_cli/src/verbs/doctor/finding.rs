//! The problems of topics, their repairs, and how both are named and described.

use crate::process;
use conduit_ring::{Nameless, Topic};
use std::fmt;
use std::path::PathBuf;

/// A problem of a topic or a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    pub topic: Option<Topic>,
    pub path: PathBuf,
    pub problem: Problem,
    /// The repair that is possible, if any.
    pub remedy: Option<Remedy>,
}

/// The kind of a problem.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Problem {
    /// Indices of reader slots whose readers are dead.
    LeakedSlots(Vec<u32>),
    /// The dead publisher's process id, unknown for a legacy publisher, and the processes that
    /// still use the file.
    PublisherDead { pid: Option<u32>, users: Vec<u32> },
    /// The topic has ended; these processes still use its file.
    Ended { users: Vec<u32> },
    /// The reason why the file is not, or not yet, a ring, and the processes that use it.
    Damaged { fault: String, users: Vec<u32> },
    /// The number of legacy readers that are registered in a file that no process uses.
    LegacyReaders(usize),
    /// Readers that hold messages which are older than the ring has slots.
    HeldSlots(Vec<Hold>),
    /// A process that publishes, or reads as a legacy peer, in a file that has lost its name.
    Nameless { pid: u32 },
    /// The reason why the file is not ours.
    Foreign(String),
}

/// A reader that holds messages in their slots.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hold {
    pub slot: u32,
    pub pid: u32,
    /// Sequence numbers of the messages.
    pub messages: Vec<u64>,
}

/// A repair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remedy {
    Reclaim,
    Remove,
    Clear,
}

impl Finding {
    /// A problem of a topic with the repair that is possible.
    pub fn of_topic(topic: &Topic, problem: Problem) -> Finding {
        Finding {
            topic: Some(topic.clone()),
            path: topic.path().to_owned(),
            remedy: problem.remedy(),
            problem,
        }
    }

    /// A process that uses a file without a name.
    pub fn nameless(found: Nameless) -> Finding {
        Finding {
            path: found.topic.path().to_owned(),
            topic: Some(found.topic),
            problem: Problem::Nameless { pid: found.pid },
            remedy: None,
        }
    }

    /// A file with the prefix of a topic's file and an invalid rest.
    pub fn misnamed(path: PathBuf) -> Finding {
        Finding {
            topic: None,
            path,
            problem: Problem::Foreign("invalid topic name".into()),
            remedy: None,
        }
    }
}

impl Problem {
    /// Returns the name in JSON and in the help.
    pub fn name(&self) -> &'static str {
        match self {
            Problem::LeakedSlots(_) => "leaked_slots",
            Problem::PublisherDead { .. } => "publisher_dead",
            Problem::Ended { .. } => "ended",
            Problem::Damaged { .. } => "damaged",
            Problem::LegacyReaders(_) => "legacy_readers",
            Problem::HeldSlots(_) => "held_slots",
            Problem::Nameless { .. } => "nameless",
            Problem::Foreign(_) => "foreign",
        }
    }

    fn remedy(&self) -> Option<Remedy> {
        match self {
            Problem::LeakedSlots(_) => Some(Remedy::Reclaim),
            Problem::LegacyReaders(_) => Some(Remedy::Clear),
            Problem::PublisherDead { users, .. }
            | Problem::Ended { users }
            | Problem::Damaged { users, .. } => users.is_empty().then_some(Remedy::Remove),
            Problem::HeldSlots(_) | Problem::Nameless { .. } | Problem::Foreign(_) => None,
        }
    }
}

impl Remedy {
    /// Returns the name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Remedy::Reclaim => "reclaim",
            Remedy::Remove => "remove",
            Remedy::Clear => "clear",
        }
    }

    /// Describes the repair that `--fix` makes.
    pub fn announcement(self) -> &'static str {
        match self {
            Remedy::Reclaim => "reclaims them",
            Remedy::Remove => "removes the file",
            Remedy::Clear => "clears their bits",
        }
    }

    /// Describes the repair that was made.
    pub fn result(self) -> &'static str {
        match self {
            Remedy::Reclaim => "reclaimed",
            Remedy::Remove => "removed",
            Remedy::Clear => "bits cleared",
        }
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Problem::LeakedSlots(slots) => {
                let slots: Vec<String> = slots.iter().map(ToString::to_string).collect();
                write!(f, "dead readers hold slots {}", slots.join(" "))
            }
            Problem::PublisherDead {
                pid: Some(pid),
                users,
            } => {
                write!(f, "publisher with pid {pid} is dead{}", InUse(users))
            }
            Problem::PublisherDead { pid: None, users } => {
                write!(f, "legacy publisher is dead{}", InUse(users))
            }
            Problem::Ended { users } => write!(f, "topic has ended{}", InUse(users)),
            Problem::Damaged { fault, users } => write!(f, "damaged ({fault}){}", InUse(users)),
            Problem::LegacyReaders(count) => {
                write!(f, "{count} dead legacy readers are registered")
            }
            Problem::HeldSlots(holds) => {
                let holds: Vec<String> = holds.iter().map(Hold::to_string).collect();
                write!(
                    f,
                    "{}, so that each lap skips a sequence number",
                    holds.join("; ")
                )
            }
            Problem::Nameless { pid } => write!(
                f,
                "{} uses a file whose name was removed or given to another file, \
                 so that no other process finds the topic",
                process::label(*pid)
            ),
            Problem::Foreign(reason) => write!(f, "not a ring ({reason})"),
        }
    }
}

impl fmt::Display for Hold {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.messages.iter().map(u64::to_string).collect();
        let (process, numbers) = (process::label(self.pid), numbers.join(", "));
        write!(
            f,
            "{process}, reader {}, holds message {numbers}",
            self.slot
        )
    }
}

/// Describes the processes that still use a file.
struct InUse<'a>(&'a [u32]);

impl fmt::Display for InUse<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let users: Vec<String> = self.0.iter().map(|&pid| process::label(pid)).collect();
        match users.as_slice() {
            [] => Ok(()),
            _ => write!(f, ", and still in use by {}", users.join(", ")),
        }
    }
}
