//! The lines that `ganglion doctor` prints: one for each problem, and a summary.

use super::finding::{Finding, Problem, Remedy};
use super::repairs::Outcome;
use crate::output::Record;
use conduit_ring::Topic;
use program::Failure;
use serde_json::{Value, json};
use std::fmt;

/// A problem and, with `--fix`, the result of its repair.
pub struct FindingRecord {
    pub finding: Finding,
    pub outcome: Option<Outcome>,
}

impl fmt::Display for FindingRecord {
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
            (Some(Outcome::Left(reason)), _) => write!(f, ": left, {reason}"),
            (None, Some(remedy)) => write!(f, "; --fix {}", remedy.announcement()),
            (None, None) => Ok(()),
        }
    }
}

impl Record for FindingRecord {
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
            Some(Outcome::Left(reason)) => {
                line["outcome"] = "left".into();
                line["reason"] = reason.clone().into();
            }
            None => {}
        }
        match &finding.problem {
            Problem::LeakedSlots(slots) => line["slots"] = slots.clone().into(),
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

/// The numbers of topics, problems and repairs.
pub struct Summary {
    topics: usize,
    fix: bool,
    findings: usize,
    repaired: usize,
}

impl Summary {
    pub fn new(topics: usize, fix: bool) -> Summary {
        Summary {
            topics,
            fix,
            findings: 0,
            repaired: 0,
        }
    }

    /// Counts a problem and the result of its repair.
    pub fn count(&mut self, outcome: Option<&Outcome>) {
        self.findings += 1;
        self.repaired += usize::from(matches!(outcome, Some(Outcome::Repaired(_))));
    }

    /// Returns the program's failure if a problem is left.
    pub fn verdict(&self) -> Result<(), Failure> {
        match (self.left(), self.fix) {
            (0, _) => Ok(()),
            (left, true) => Err(Failure::Runtime(format!("{} left", problems(left)))),
            (left, false) => Err(Failure::Runtime(format!(
                "{} found; run ganglion doctor --fix to make the safe repairs",
                problems(left)
            ))),
        }
    }

    fn left(&self) -> usize {
        self.findings - self.repaired
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
