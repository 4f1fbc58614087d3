//! `ganglion doctor`: what kills have left in /dev/shm.

mod diagnosis;

use super::Verb;
use crate::options::Options;
use crate::output::{Output, Record};
use crate::{process, world};
use conduit_ring::repair::{self, Repair};
use conduit_ring::{Error, Info, Listing, State, Topic, nameless_publishers};
use diagnosis::{Case, Finding, Problem, Remedy};
use program::{Failure, Log};
use serde_json::{Value, json};
use std::fmt;
use std::time::{Duration, Instant};

pub const VERB: Verb = Verb {
    name: "doctor",
    summary: "finds what kills have left, and repairs it",
    help: HELP,
    takes_topic: false,
    options: &["--fix", "--keep-dead", "--prefix", "--json", "--help"],
    run,
};

const HELP: &str = "\
ganglion doctor: finds what kills have left in /dev/shm, and repairs it

Usage: ganglion doctor [options]

  --fix           repair what is safe
  --keep-dead     leave the files of dead publishers, with which their successors go on in place
  --prefix NAME   only topics whose names begin so
  --json          one JSON object a line, for each problem, and one that sums up
  --help          this text

Exit status: 0 when nothing was found or all of it was repaired, else 1. Only what is seen twice, 0.1 seconds apart, is a
problem. The ring works on with any of these; they take up memory and reader slots.

What it finds, and what --fix does about it:

  leaked_slots      Reader slots of dead readers. Taken back, each under its lock, as the next subscriber would. This is
                    all that is ever done to a topic whose publisher lives.
  publisher_dead    A file whose publisher is dead; of a legacy one that is known when nobody but readers of ours has it. Removed if no process has it open or mapped; as long as a reader
                    waits there for the next publisher, or if that cannot be known, it stays.
  ended             A file whose topic was closed or replaced. The same.
  damaged           A file that was a ring, or was to become one, and is not. The same, and only if it shows that it was
                    one: the ring's magic number, a valid geometry, or a header of zeros.
  legacy_readers    Slots of legacy readers in a file that no process has open or mapped: they hold no lock, and only so
                    is it certain that they are dead. Their bits are cleared.
  held_slots        Readers that hold a message in its slot for longer than the ring takes to go round: hung or stopped, for
                    one. The publisher passes the slot over, and each lap costs the topic one number. Named, not touched.
  nameless          A process that publishes in a file whose name was removed or given to another one, so that nobody
                    finds the topic. Publishers of this project make it anew by themselves; one that is still there has
                    no name to take, or is silent, or a legacy one. Named, not touched.
  foreign           What is in the topics' place and no ring: other files, directories, symbolic links, names that no
                    topic can have, later versions, files that may not be read. Never touched.

Whether a process has a file is asked of the kernel (a write lease), which sees other users' and containers' too. Only a
file's owner and root may ask; for others it counts as in use. While a file is removed or its bits are cleared, its
publisher's lock is held, so that no publisher begins there.
";

/// From one look to the next: longer than a publisher or reader takes to come or go.
const BETWEEN_LOOKS: Duration = Duration::from_millis(100);

fn run(options: &Options, output: &mut Output, _log: Log) -> Result<(), Failure> {
    let (topics, mut findings) = examine(options)?;
    if !findings.is_empty() {
        if output.stop().wait_until(Instant::now() + BETWEEN_LOOKS) {
            return Ok(());
        }
        let (_, again) = examine(options)?;
        findings.retain(|finding| again.contains(finding));
    }
    let mut summary = Summary::of(topics, options.fix);
    for finding in findings {
        let outcome = options.fix.then(|| treat(&finding));
        summary.count(outcome.as_ref());
        output.put(&Report { finding, outcome })?;
    }
    output.put(&summary)?;
    summary.verdict()
}

/// How many topics there are, and what is wrong with them.
fn examine(options: &Options) -> Result<(usize, Vec<Finding>), Failure> {
    let listing = Listing::read().map_err(world)?;
    let named = |topic: &Topic| topic.name().starts_with(&options.prefix);
    let topics: Vec<Topic> = listing.topics.into_iter().filter(named).collect();
    let count = topics.len();
    let cases = topics.into_iter().filter_map(look);
    let mut findings: Vec<Finding> = cases
        .flat_map(|case| diagnosis::diagnose(&case, options.keep_dead))
        .collect();
    let nameless = nameless_publishers().into_iter();
    findings.extend(
        nameless
            .filter(|found| named(&found.topic))
            .map(Finding::nameless),
    );
    if options.prefix.is_empty() {
        findings.extend(listing.misnamed.into_iter().map(Finding::misnamed));
    }
    Ok((count, findings))
}

/// `None` when the topic is not there any more.
fn look(topic: Topic) -> Option<Case> {
    let info = match Info::read(&topic) {
        Err(Error::NoTopic { .. }) => return None,
        info => info,
    };
    let is_live = info.as_ref().is_ok_and(|info| info.state == State::Live);
    let users = if is_live {
        Vec::new()
    } else {
        process::users_of(topic.path())
    };
    let is_legacy = info.as_ref().is_ok_and(|info| info.state == State::Legacy);
    let left_by_legacy = is_legacy && repair::is_left_by_legacy_publisher(&topic).unwrap_or(false);
    Some(Case {
        topic,
        info,
        users,
        left_by_legacy,
    })
}

/// What became of a problem.
enum Outcome {
    Repaired(&'static str),
    Left(String),
}

fn treat(finding: &Finding) -> Outcome {
    let (Some(topic), Some(remedy)) = (&finding.topic, finding.remedy) else {
        return Outcome::Left("nothing that is safe can be done".into());
    };
    let made = match remedy {
        Remedy::Reclaim => reclaim(topic),
        Remedy::Clear => repair::clear_legacy_readers(topic),
        Remedy::Remove => repair::remove_abandoned(topic),
    };
    match made {
        Ok(Repair::Made) => Outcome::Repaired(remedy.done()),
        Ok(Repair::NotNeeded) | Err(Error::NoTopic { .. }) => Outcome::Repaired("gone by itself"),
        Ok(Repair::PublisherAlive) => Outcome::Left("it has a publisher now".into()),
        Ok(Repair::InUse) => Outcome::Left("a process has it open, or that cannot be known".into()),
        Ok(Repair::NotARing) => Outcome::Left("nothing shows that it ever was a ring".into()),
        Ok(other) => Outcome::Left(format!("{other:?}")),
        Err(error) => Outcome::Left(error.to_string()),
    }
}

fn reclaim(topic: &Topic) -> Result<Repair, Error> {
    let taken_back = repair::reclaim_readers(topic)?;
    Ok(if taken_back > 0 {
        Repair::Made
    } else {
        Repair::NotNeeded
    })
}

struct Report {
    finding: Finding,
    outcome: Option<Outcome>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Finding {
            path,
            problem,
            remedy,
            ..
        } = &self.finding;
        write!(f, "{}: {problem}", path.display())?;
        match (&self.outcome, remedy) {
            (Some(Outcome::Repaired(how)), _) => write!(f, ": {how}"),
            (Some(Outcome::Left(why)), _) => write!(f, ": left, {why}"),
            (None, Some(remedy)) => write!(f, "; --fix {}", remedy.promise()),
            (None, None) => Ok(()),
        }
    }
}

impl Record for Report {
    fn json(&self) -> Value {
        let finding = &self.finding;
        let mut line = json!({
            "event": "finding",
            "topic": finding.topic.as_ref().map(Topic::name),
            "file": finding.path.to_string_lossy(),
            "problem": finding.problem.name(),
            "detail": finding.problem.to_string(),
            "remedy": finding.remedy.map(Remedy::name),
        });
        match &self.outcome {
            Some(Outcome::Repaired(_)) => line["outcome"] = "repaired".into(),
            Some(Outcome::Left(why)) => {
                line["outcome"] = "left".into();
                line["reason"] = why.clone().into();
            }
            None => {}
        }
        if let Problem::LeakedSlots(slots) = &finding.problem {
            line["slots"] = slots.clone().into();
        }
        match &finding.problem {
            Problem::Nameless { pid } => line["pid"] = (*pid).into(),
            Problem::HeldSlots(holds) => {
                let holds = holds.iter().map(
                    |hold| json!({"slot": hold.slot, "pid": hold.pid, "messages": hold.messages}),
                );
                line["holders"] = holds.collect();
            }
            _ => {}
        }
        line
    }
}

struct Summary {
    topics: usize,
    fix: bool,
    findings: usize,
    repaired: usize,
}

impl Summary {
    fn of(topics: usize, fix: bool) -> Summary {
        Summary {
            topics,
            fix,
            findings: 0,
            repaired: 0,
        }
    }

    fn count(&mut self, outcome: Option<&Outcome>) {
        self.findings += 1;
        self.repaired += usize::from(matches!(outcome, Some(Outcome::Repaired(_))));
    }

    fn left(&self) -> usize {
        self.findings - self.repaired
    }

    fn verdict(&self) -> Result<(), Failure> {
        match (self.left(), self.fix) {
            (0, _) => Ok(()),
            (left, true) => Err(Failure::Runtime(format!("{} left", problems(left)))),
            (left, false) => Err(Failure::Runtime(format!(
                "{} found; ganglion doctor --fix repairs what is safe",
                problems(left)
            ))),
        }
    }
}

fn problems(count: usize) -> String {
    match count {
        1 => "1 problem".into(),
        count => format!("{count} problems"),
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "topics {}  problems {}", self.topics, self.findings)?;
        if self.fix {
            write!(f, "  repaired {}  left {}", self.repaired, self.left())?;
        }
        Ok(())
    }
}

impl Record for Summary {
    fn json(&self) -> Value {
        json!({
            "event": "summary",
            "topics": self.topics,
            "findings": self.findings,
            "repaired": self.repaired,
            "left": self.left(),
        })
    }
}
