//! What is wrong with a topic, decided from what was seen of it.

use crate::process;
use conduit_ring::{Error, Fault, Info, Nameless, Reader, State, Topic};
use std::fmt;
use std::path::PathBuf;

/// What was seen of a topic.
pub struct Case {
    pub topic: Topic,
    pub info: Result<Info, Error>,
    /// Processes that can be seen to have its file. Not looked for while its publisher lives.
    pub users: Vec<u32>,
    /// Whether it was made by a legacy publisher that no process is any more.
    pub left_by_legacy: bool,
}

/// Something that is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    pub topic: Option<Topic>,
    pub path: PathBuf,
    pub problem: Problem,
    /// What may be done about it; `None` is nothing.
    pub remedy: Option<Remedy>,
}

/// In which way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Problem {
    /// Numbers of reader slots whose readers are dead.
    LeakedSlots(Vec<u32>),
    /// The publisher was this process, unless it was a legacy one; these still have the file.
    PublisherDead { pid: Option<u32>, users: Vec<u32> },
    /// The topic is over and its file is there; these still have it.
    Ended { users: Vec<u32> },
    /// Why it is no ring any more, or not yet; these have it.
    Damaged { fault: String, users: Vec<u32> },
    /// So many legacy readers are entered in a file that nobody has.
    LegacyReaders(usize),
    /// These readers hold messages that are older than the ring has slots.
    HeldSlots(Vec<Hold>),
    /// This process publishes, or reads as a legacy peer, in a file that has lost its name.
    Nameless { pid: u32 },
    /// Why it is none of ours.
    Foreign(String),
}

/// A reader that holds messages in their slots.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hold {
    pub slot: u32,
    pub pid: u32,
    /// The numbers of the messages.
    pub messages: Vec<u64>,
}

/// What may be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remedy {
    Reclaim,
    Remove,
    Clear,
}

/// All that is wrong with a topic, in the order in which it is to be repaired.
pub fn diagnose(case: &Case, keep_dead: bool) -> Vec<Finding> {
    let unused = case.users.is_empty();
    let info = match &case.info {
        Ok(info) => info,
        Err(error) => {
            return fault(error, &case.users)
                .map(|found| case.found(found))
                .into_iter()
                .collect();
        }
    };
    let mut problems = Vec::new();
    let leaked: Vec<u32> = info
        .readers
        .iter()
        .filter(|r| !r.alive)
        .map(|r| r.index)
        .collect();
    if !leaked.is_empty() {
        problems.push(Problem::LeakedSlots(leaked));
    }
    let holds = holds(info);
    if !holds.is_empty() {
        problems.push(Problem::HeldSlots(holds));
    }
    let legacy = info.readers.iter().filter(|reader| !reader.native).count();
    if unused && legacy > 0 && info.state != State::Live {
        problems.push(Problem::LegacyReaders(legacy));
    }
    problems.extend(end(info, case, keep_dead));
    problems
        .into_iter()
        .map(|problem| case.found(problem))
        .collect()
}

/// Those who hold messages for longer than a lap: each costs the topic a number in every lap.
fn holds(info: &Info) -> Vec<Hold> {
    let slots = u64::from(info.geometry.slot_count());
    let is_old = |number: &u64| info.published.saturating_sub(*number) > slots;
    let held = |reader: &Reader| Hold {
        slot: reader.index,
        pid: reader.pid,
        messages: reader.held.iter().copied().filter(is_old).collect(),
    };
    let living = info.readers.iter().filter(|reader| reader.alive);
    living
        .map(held)
        .filter(|hold| !hold.messages.is_empty())
        .collect()
}

/// Why a topic's file should not be there any more.
fn end(info: &Info, case: &Case, keep_dead: bool) -> Option<Problem> {
    let users = case.users.clone();
    match info.state {
        State::Live => None,
        State::Dead if keep_dead => None,
        State::Dead => Some(Problem::PublisherDead {
            pid: Some(info.writer_pid),
            users,
        }),
        // A legacy publisher has its own file mapped as long as it lives.
        State::Legacy if users.is_empty() || case.left_by_legacy => {
            Some(Problem::PublisherDead { pid: None, users })
        }
        State::Legacy => None,
        State::Closed | State::Retired => Some(Problem::Ended { users }),
        _ => Some(Problem::Damaged {
            fault: "its state is none that there is".into(),
            users,
        }),
    }
}

/// What is wrong with a file that cannot be read as a ring.
fn fault(error: &Error, users: &[u32]) -> Option<Problem> {
    let users = users.to_vec();
    match error {
        // A legacy publisher is making it.
        Error::BadSegment {
            fault: Fault::NotReady,
            ..
        } if !users.is_empty() => None,
        Error::BadSegment {
            fault: fault @ (Fault::NotAFile | Fault::Version),
            ..
        } => Some(Problem::Foreign(fault.to_string())),
        Error::BadSegment { fault, .. } => Some(Problem::Damaged {
            fault: fault.to_string(),
            users,
        }),
        Error::Os { action, source, .. } => Some(Problem::Foreign(format!("{action}: {source}"))),
        other => Some(Problem::Foreign(other.to_string())),
    }
}

impl Case {
    fn found(&self, problem: Problem) -> Finding {
        Finding {
            topic: Some(self.topic.clone()),
            path: self.topic.path().to_owned(),
            remedy: problem.remedy(),
            problem,
        }
    }
}

impl Finding {
    /// A process that goes on in a file without a name.
    pub fn nameless(found: Nameless) -> Finding {
        Finding {
            path: found.topic.path().to_owned(),
            topic: Some(found.topic),
            problem: Problem::Nameless { pid: found.pid },
            remedy: None,
        }
    }

    /// A file that begins as a topic's does and goes on otherwise.
    pub fn misnamed(path: PathBuf) -> Finding {
        Finding {
            topic: None,
            path,
            problem: Problem::Foreign("its name is no topic's".into()),
            remedy: None,
        }
    }
}

impl Problem {
    /// Its name in JSON and in the help.
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
    /// Its name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Remedy::Reclaim => "reclaim",
            Remedy::Remove => "remove",
            Remedy::Clear => "clear",
        }
    }

    /// What `--fix` does.
    pub fn promise(self) -> &'static str {
        match self {
            Remedy::Reclaim => "takes them back",
            Remedy::Remove => "removes it",
            Remedy::Clear => "clears their bits",
        }
    }

    /// What was done.
    pub fn done(self) -> &'static str {
        match self {
            Remedy::Reclaim => "taken back",
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
                write!(f, "its publisher, pid {pid}, is dead{}", Holders(users))
            }
            Problem::PublisherDead { pid: None, users } => {
                write!(f, "its legacy publisher is dead{}", Holders(users))
            }
            Problem::Ended { users } => write!(f, "its topic has ended{}", Holders(users)),
            Problem::Damaged { fault, users } => write!(f, "damaged, {fault}{}", Holders(users)),
            Problem::LegacyReaders(count) => write!(f, "{count} dead legacy readers are entered"),
            Problem::HeldSlots(holds) => {
                let holds: Vec<String> = holds.iter().map(Hold::to_string).collect();
                write!(
                    f,
                    "{}, which costs the topic a number in each lap",
                    holds.join("; ")
                )
            }
            Problem::Nameless { pid } => write!(
                f,
                "{} goes on with it, but its name was removed or leads to another file; nobody else finds it",
                process::label(*pid)
            ),
            Problem::Foreign(why) => write!(f, "no ring of ours, {why}"),
        }
    }
}

impl fmt::Display for Hold {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers: Vec<String> = self.messages.iter().map(u64::to_string).collect();
        let (who, what) = (process::label(self.pid), numbers.join(", "));
        write!(f, "{who}, reader {}, holds message {what}", self.slot)
    }
}

/// Those who still have a file.
struct Holders<'a>(&'a [u32]);

impl fmt::Display for Holders<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let holders: Vec<String> = self.0.iter().map(|&pid| process::label(pid)).collect();
        match holders.as_slice() {
            [] => Ok(()),
            _ => write!(f, ", and still in use by {}", holders.join(", ")),
        }
    }
}
