//! What a run came to, for people and for programs.

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// What the random choices followed from.
    pub seed: u64,
    /// Processes killed.
    pub kills: u64,
    /// Those of them that were BEAM nodes.
    pub node_kills: u64,
    /// Messages that their publishers were killed in the midst of.
    pub half_written: u64,
    /// Messages accepted by all readers together.
    pub messages: u64,
    /// Torn messages accepted.
    pub torn: u64,
    /// Topics that did not flow again, or whose processes could not go on.
    pub stuck: u64,
    /// Reader slots that nobody has and nobody can get.
    pub leaked: u64,
    /// Numbers given to two messages.
    pub reused: u64,
    /// Losses that a reader was not told about.
    pub untold: u64,
    /// How long it took.
    pub seconds: u64,
    /// From the last kill to the first message on the last topic and reader.
    pub settled_ms: u64,
}

impl Report {
    /// Whether all that is promised was kept.
    pub fn is_clean(&self) -> bool {
        [self.torn, self.stuck, self.leaked, self.reused, self.untold] == [0; 5]
    }

    /// For people.
    pub fn text(&self) -> String {
        format!(
            "{} kills ({} of BEAM nodes, {} in the midst of a message) in {} s, seed {}; {} messages accepted\n\
             torn {}, stuck {}, leaked {}, reused {}, losses untold {}; all topics flowed {} ms after the last kill",
            self.kills,
            self.node_kills,
            self.half_written,
            self.seconds,
            self.seed,
            self.messages,
            self.torn,
            self.stuck,
            self.leaked,
            self.reused,
            self.untold,
            self.settled_ms
        )
    }

    /// For programs: one line.
    pub fn json(&self) -> String {
        format!(
            r#"{{"kills": {}, "messages": {}, "torn": {}, "stuck": {}, "leaked": {}, "reused": {}}}"#,
            self.kills, self.messages, self.torn, self.stuck, self.leaked, self.reused
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CLEAN: Report = Report {
        seed: 1,
        kills: 2,
        node_kills: 1,
        half_written: 1,
        messages: 3,
        torn: 0,
        stuck: 0,
        leaked: 0,
        reused: 0,
        untold: 0,
        seconds: 4,
        settled_ms: 5,
    };

    #[test]
    fn a_run_is_clean_only_if_nothing_was_found() {
        assert!(CLEAN.is_clean());
        for spoilt in [
            Report { torn: 1, ..CLEAN },
            Report { stuck: 1, ..CLEAN },
            Report { leaked: 1, ..CLEAN },
            Report { reused: 1, ..CLEAN },
            Report { untold: 1, ..CLEAN },
        ] {
            assert!(!spoilt.is_clean());
        }
    }

    #[test]
    fn the_line_for_programs_has_six_numbers() {
        assert_eq!(
            CLEAN.json(),
            r#"{"kills": 2, "messages": 3, "torn": 0, "stuck": 0, "leaked": 0, "reused": 0}"#
        );
    }
}
