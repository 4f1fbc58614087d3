//! The listener for edges and the messages that it receives.

use gpiocdev_uapi::v2::{LineEdgeEvent, LineEdgeEventKind};
use rustler::{Encoder, Env, LocalPid, NifMap, NifUnitEnum, OwnedEnv, Term, env::SavedTerm};

use crate::settings::Trigger;

mod atoms {
    rustler::atoms! { circuits_gpio }
}

/// The form of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, NifUnitEnum)]
pub enum Form {
    /// `{:circuits_gpio, label, timestamp_ns, level}`.
    Edge,
    /// `{:circuits_gpio, %{ref: label, timestamp: ns, value: levels, previous_value: levels}}`.
    Change,
}

/// A term that outlives the NIF call which passed it.
pub struct Label {
    env: OwnedEnv,
    term: SavedTerm,
}

impl Label {
    /// Copies a term.
    pub fn new(term: Term) -> Self {
        let env = OwnedEnv::new();
        let term = env.save(term);
        Self { env, term }
    }

    fn copy<'a>(&self, env: Env<'a>) -> Term<'a> {
        self.env.run(|own| self.term.load(own).in_env(env))
    }
}

/// The levels of lines, one bit each, as they follow from the edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Levels(pub u64);

impl Levels {
    /// Applies an edge and returns the change, or `None` for an unknown kind of edge.
    fn follow(&mut self, bit: usize, kind: u32) -> Option<Change> {
        let before = self.0;
        let level = match LineEdgeEventKind::try_from(kind).ok()? {
            LineEdgeEventKind::RisingEdge => 1,
            LineEdgeEventKind::FallingEdge => 0,
        };
        self.0 = (before & !(1 << bit)) | (level << bit);
        Some(Change {
            level,
            before,
            after: self.0,
        })
    }
}

/// The change of the levels by one edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Change {
    level: u64,
    before: u64,
    after: u64,
}

impl Change {
    fn matches(&self, trigger: Trigger) -> bool {
        match trigger {
            Trigger::None => false,
            Trigger::Rising => self.level == 1,
            Trigger::Falling => self.level == 0,
            Trigger::Both => true,
        }
    }
}

/// The map of [`Form::Change`].
#[derive(NifMap)]
struct ChangeTerm<'a> {
    r#ref: Term<'a>,
    timestamp: u64,
    value: u64,
    previous_value: u64,
}

/// The receiver process is dead.
#[derive(Debug)]
pub struct Gone;

/// A process that receives edges.
pub struct Listener {
    pub receiver: LocalPid,
    pub trigger: Trigger,
    pub form: Form,
    pub label: Label,
    pub levels: Levels,
}

impl Listener {
    /// Returns the edges that the kernel must report: all of them if levels are tracked.
    pub fn edges(&self) -> Trigger {
        match (self.form, self.trigger) {
            (_, Trigger::None) => Trigger::None,
            (Form::Change, _) => Trigger::Both,
            (Form::Edge, trigger) => trigger,
        }
    }

    /// Sends an edge of the line with this bit if it matches the trigger.
    pub fn send(
        &mut self,
        message: &mut OwnedEnv,
        bit: usize,
        event: &LineEdgeEvent,
    ) -> Result<(), Gone> {
        let change = self.levels.follow(bit, event.kind);
        let Some(change) = change.filter(|change| change.matches(self.trigger)) else {
            return Ok(());
        };
        let term = |env| self.encode(env, change, event.timestamp_ns);
        message
            .send_and_clear(&self.receiver, term)
            .map_err(|_| Gone)
    }

    fn encode<'a>(&self, env: Env<'a>, change: Change, timestamp: u64) -> Term<'a> {
        let label = self.label.copy(env);
        match self.form {
            Form::Edge => (atoms::circuits_gpio(), label, timestamp, change.level).encode(env),
            Form::Change => {
                let change = ChangeTerm {
                    r#ref: label,
                    timestamp,
                    value: change.after,
                    previous_value: change.before,
                };
                (atoms::circuits_gpio(), change).encode(env)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RISING: u32 = 1;
    const FALLING: u32 = 2;

    #[test]
    fn levels_follow_the_edges_of_each_line() {
        let mut levels = Levels(0b10);
        let change = levels.follow(0, RISING).unwrap();
        assert_eq!((change.before, change.after, change.level), (0b10, 0b11, 1));
        let change = levels.follow(1, FALLING).unwrap();
        assert_eq!((change.before, change.after, change.level), (0b11, 0b01, 0));
        assert_eq!(levels, Levels(0b01));
    }

    #[test]
    fn the_last_of_64_lines_has_a_bit() {
        let mut levels = Levels(0);
        assert_eq!(levels.follow(63, RISING).unwrap().after, 1 << 63);
    }

    #[test]
    fn an_edge_of_an_unknown_kind_changes_nothing() {
        let mut levels = Levels(1);
        assert_eq!(levels.follow(0, 3), None);
        assert_eq!(levels, Levels(1));
    }

    #[test]
    fn a_trigger_matches_by_the_new_level() {
        let rise = Levels(0).follow(0, RISING).unwrap();
        let fall = Levels(1).follow(0, FALLING).unwrap();
        let matches = |trigger| [rise.matches(trigger), fall.matches(trigger)];
        assert_eq!(matches(Trigger::Both), [true, true]);
        assert_eq!(matches(Trigger::Rising), [true, false]);
        assert_eq!(matches(Trigger::Falling), [false, true]);
        assert_eq!(matches(Trigger::None), [false, false]);
    }
}
