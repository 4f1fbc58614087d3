//! The result of a run.

/// The result of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// The seed of the random choices.
    pub seed: u64,
    /// Number of killed processes.
    pub kills: u64,
    /// Number of killed BEAM nodes.
    pub node_kills: u64,
    /// Number of messages whose publisher was killed while it wrote them.
    pub half_written: u64,
    /// Number of messages accepted by all readers.
    pub messages: u64,
    /// Number of accepted torn messages.
    pub torn: u64,
    /// Number of topics that did not recover or whose processes ended by themselves.
    pub stuck: u64,
    /// Number of reader slots that no reader has and none can get.
    pub leaked: u64,
    /// Number of sequence numbers with two messages.
    pub reused: u64,
    /// Number of losses that were not reported to the reader.
    pub unreported: u64,
    /// The duration of the run.
    pub seconds: u64,
    /// The time from the last kill until all readers had a new message.
    pub recovery_ms: u64,
}

impl Report {
    /// Returns whether the run found no fault.
    pub fn is_clean(&self) -> bool {
        [
            self.torn,
            self.stuck,
            self.leaked,
            self.reused,
            self.unreported,
        ] == [0; 5]
    }

    /// Returns the result as text.
    pub fn text(&self) -> String {
        format!(
            "{} kills ({} of BEAM nodes, {} during a message) in {} s, seed {}; \
             {} messages accepted\n\
             torn {}, stuck {}, leaked {}, reused {}, unreported losses {}; \
             all topics delivered messages {} ms after the last kill",
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
            self.unreported,
            self.recovery_ms
        )
    }

    /// Returns the result as one line of JSON.
    pub fn json(&self) -> String {
        format!(
            "{{\"kills\": {}, \"messages\": {}, \"torn\": {}, \"stuck\": {}, \"leaked\": {}, \
             \"reused\": {}}}",
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
        unreported: 0,
        seconds: 4,
        recovery_ms: 5,
    };

    #[test]
    fn only_a_run_without_findings_is_clean() {
        assert!(CLEAN.is_clean());
        for faulty in [
            Report { torn: 1, ..CLEAN },
            Report { stuck: 1, ..CLEAN },
            Report { leaked: 1, ..CLEAN },
            Report { reused: 1, ..CLEAN },
            Report {
                unreported: 1,
                ..CLEAN
            },
        ] {
            assert!(!faulty.is_clean());
        }
    }

    #[test]
    fn the_json_line_has_six_numbers() {
        assert_eq!(
            CLEAN.json(),
            r#"{"kills": 2, "messages": 3, "torn": 0, "stuck": 0, "leaked": 0, "reused": 0}"#
        );
    }
}
