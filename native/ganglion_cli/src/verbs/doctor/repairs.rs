//! Repairs a problem.

use super::finding::{Finding, Remedy};
use conduit_ring::repair::{self, Repair};
use conduit_ring::{Error, Topic};

/// The result of a repair.
pub enum Outcome {
    /// The problem no longer exists; how it was repaired.
    Repaired(&'static str),
    /// The problem remains; the reason.
    Left(String),
}

/// Makes the repair that a finding allows.
pub fn repair(finding: &Finding) -> Outcome {
    let (Some(topic), Some(remedy)) = (&finding.topic, finding.remedy) else {
        return Outcome::Left("no safe repair exists".into());
    };
    let repaired = match remedy {
        Remedy::Reclaim => reclaim(topic),
        Remedy::Clear => repair::clear_legacy_readers(topic),
        Remedy::Remove => repair::remove_abandoned(topic),
    };
    match repaired {
        Ok(Repair::Made) => Outcome::Repaired(remedy.result()),
        Ok(Repair::NotNeeded) | Err(Error::NoTopic { .. }) => Outcome::Repaired("already gone"),
        Ok(Repair::PublisherAlive) => Outcome::Left("a publisher has started".into()),
        Ok(Repair::InUse) => Outcome::Left("a process has, or may have, the file open".into()),
        Ok(Repair::NotARing) => Outcome::Left("no sign that the file was ever a ring".into()),
        Ok(other) => Outcome::Left(format!("{other:?}")),
        Err(error) => Outcome::Left(error.to_string()),
    }
}

fn reclaim(topic: &Topic) -> Result<Repair, Error> {
    let reclaimed = repair::reclaim_readers(topic)?;
    Ok(if reclaimed > 0 {
        Repair::Made
    } else {
        Repair::NotNeeded
    })
}
