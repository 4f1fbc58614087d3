//! Decides from the state of a topic which problems it has. Pure.

use super::finding::{Finding, Hold, Problem};
use conduit_ring::{Error, Fault, Info, Reader, State, Topic};

/// The observed state of a topic.
pub struct Case {
    pub topic: Topic,
    pub info: Result<Info, Error>,
    /// Processes that visibly have the file mapped or open. Empty for a live topic.
    pub users: Vec<u32>,
    /// Whether the topic is of a legacy publisher that no longer runs.
    pub left_by_legacy: bool,
}

/// Returns all problems of a topic in the order in which they are repaired.
pub fn diagnose(case: &Case, keep_dead: bool) -> Vec<Finding> {
    let unused = case.users.is_empty();
    let info = match &case.info {
        Ok(info) => info,
        Err(error) => {
            return unreadable(error, &case.users)
                .map(|found| Finding::of_topic(&case.topic, found))
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
    problems.extend(leftover(info, case, keep_dead));
    problems
        .into_iter()
        .map(|problem| Finding::of_topic(&case.topic, problem))
        .collect()
}

/// Returns the readers that hold messages for longer than a lap. Each costs the topic a sequence
/// number in every lap.
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

/// Returns the reason why a topic's file should no longer exist, if any.
fn leftover(info: &Info, case: &Case, keep_dead: bool) -> Option<Problem> {
    let users = case.users.clone();
    match info.state {
        State::Live => None,
        State::Dead if keep_dead => None,
        State::Dead => Some(Problem::PublisherDead {
            pid: Some(info.writer_pid),
            users,
        }),
        // A legacy publisher has its file mapped for as long as it lives.
        State::Legacy if users.is_empty() || case.left_by_legacy => {
            Some(Problem::PublisherDead { pid: None, users })
        }
        State::Legacy => None,
        State::Closed | State::Retired => Some(Problem::Ended { users }),
        _ => Some(Problem::Damaged {
            fault: "unknown state".into(),
            users,
        }),
    }
}

/// Returns the problem of a file that cannot be read as a ring.
fn unreadable(error: &Error, users: &[u32]) -> Option<Problem> {
    let users = users.to_vec();
    match error {
        // A legacy publisher is creating it.
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
