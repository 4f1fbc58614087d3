//! What may not happen, told from what the subscribers noted. Pure: records in, counts out.

use std::collections::{BTreeMap, HashMap};

use crate::record::Record;

/// One life of a process that reads; its messages of one topic come in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Life(pub u64);

/// Messages of one segment by number: who wrote it, and its checksum.
type Numbers = HashMap<u64, (u64, u32)>;

/// What was found so far.
#[derive(Debug, Default)]
pub struct Judge {
    /// Messages accepted.
    pub messages: u64,
    /// Messages accepted that were not what had been published.
    pub torn: u64,
    /// Numbers under which two different messages were accepted, or one twice by the same reader.
    pub reused: u64,
    /// Gaps in a reader's numbers that it was not told about.
    pub untold: u64,
    /// The first few findings in words.
    pub findings: Vec<String>,
    segments: HashMap<(u32, u64), Numbers>,
    readers: HashMap<(Life, u32), Place>,
    newest: BTreeMap<u32, u64>,
}

/// Where a reader is.
#[derive(Clone, Copy, Debug)]
struct Place {
    instance: u64,
    sequence: u64,
    timestamp_ns: u64,
}

const FINDINGS_TOLD: usize = 20;

impl Judge {
    /// Takes a record of a reader; `in_order` if it reads on and on, and does not begin anew within its life.
    pub fn take(&mut self, life: Life, in_order: bool, record: &Record) {
        self.messages += 1;
        if !record.whole {
            self.torn += 1;
            self.find(|| format!("torn: {record:?}"));
            // What it should have been is not known, so neither is what must follow.
            self.readers.remove(&(life, record.topic));
            return;
        }
        self.check_number(record);
        if in_order {
            self.check_order(life, record);
        }
        let newest = self.newest.entry(record.topic).or_default();
        *newest = record.timestamp_ns.max(*newest);
    }

    /// When the newest message that `life` has accepted of `topic` was published.
    pub fn newest_of(&self, life: Life, topic: u32) -> Option<u64> {
        self.readers
            .get(&(life, topic))
            .map(|place| place.timestamp_ns)
    }

    /// When the newest message that anyone has accepted of `topic` was published.
    pub fn newest(&self, topic: u32) -> Option<u64> {
        self.newest.get(&topic).copied()
    }

    /// Forgets a reader that has died.
    pub fn bury(&mut self, life: Life) {
        self.readers.retain(|(reader, _), _| *reader != life);
    }

    fn check_number(&mut self, record: &Record) {
        let message = (record.writer, record.checksum);
        let known = *self
            .segments
            .entry((record.topic, record.instance))
            .or_default()
            .entry(record.sequence)
            .or_insert(message);
        if known != message {
            self.reused += 1;
            self.find(|| format!("reused: {record:?} is not {known:x?}"));
        }
    }

    fn check_order(&mut self, life: Life, record: &Record) {
        let place = Place {
            instance: record.instance,
            sequence: record.sequence,
            timestamp_ns: record.timestamp_ns,
        };
        let Some(before) = self.readers.insert((life, record.topic), place) else {
            return;
        };
        if before.instance != record.instance {
            return;
        }
        if record.sequence <= before.sequence {
            self.reused += 1;
            self.find(|| format!("given twice: {record:?} after {before:?}"));
        } else if record.sequence != before.sequence + 1 + u64::from(record.lost) {
            self.untold += 1;
            self.find(|| format!("untold loss: {record:?} after {before:?}"));
        }
    }

    fn find(&mut self, finding: impl FnOnce() -> String) {
        if self.findings.len() < FINDINGS_TOLD {
            self.findings.push(finding());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(sequence: u64) -> Record {
        Record {
            whole: true,
            topic: 1,
            sequence,
            instance: 7,
            writer: 100,
            checksum: sequence as u32,
            lost: 0,
            timestamp_ns: sequence,
        }
    }

    fn judge(records: &[(u64, Record)]) -> Judge {
        let mut judge = Judge::default();
        for (life, record) in records {
            judge.take(Life(*life), true, record);
        }
        judge
    }

    fn counts(judge: &Judge) -> [u64; 4] {
        [judge.messages, judge.torn, judge.reused, judge.untold]
    }

    #[test]
    fn readers_that_accept_the_same_messages_are_in_order() {
        let lost = Record {
            lost: 3,
            ..message(6)
        };
        let records = [
            (1, message(0)),
            (2, message(0)),
            (1, message(1)),
            (1, message(2)),
            (1, lost),
        ];
        assert_eq!(counts(&judge(&records)), [5, 0, 0, 0]);
    }

    #[test]
    fn a_torn_message_is_counted() {
        let torn = Record {
            whole: false,
            ..message(3)
        };
        assert_eq!(counts(&judge(&[(1, torn)])), [1, 1, 0, 0]);
    }

    #[test]
    fn two_messages_under_one_number_are_counted_whoever_accepted_them() {
        let other_writer = Record {
            writer: 101,
            ..message(4)
        };
        let other_bytes = Record {
            checksum: 9,
            ..message(4)
        };
        for other in [other_writer, other_bytes] {
            assert_eq!(counts(&judge(&[(1, message(4)), (2, other)])), [2, 0, 1, 0]);
        }
    }

    #[test]
    fn the_same_number_of_another_segment_or_topic_is_another_number() {
        let elsewhere = Record {
            instance: 8,
            writer: 101,
            ..message(0)
        };
        let other_topic = Record {
            topic: 2,
            writer: 101,
            ..message(0)
        };
        let records = [(1, message(0)), (1, elsewhere), (1, other_topic)];
        assert_eq!(counts(&judge(&records)), [3, 0, 0, 0]);
    }

    #[test]
    fn a_message_given_twice_to_one_reader_is_counted() {
        assert_eq!(
            counts(&judge(&[(1, message(4)), (1, message(4))])),
            [2, 0, 1, 0]
        );
    }

    #[test]
    fn a_reader_that_begins_anew_may_get_a_message_again() {
        let mut judge = Judge::default();
        judge.take(Life(1), false, &message(4));
        judge.take(Life(1), false, &message(4));
        assert_eq!(counts(&judge), [2, 0, 0, 0]);
    }

    #[test]
    fn a_gap_that_was_not_told_is_counted() {
        assert_eq!(
            counts(&judge(&[(1, message(4)), (1, message(6))])),
            [2, 0, 0, 1]
        );
    }

    #[test]
    fn it_is_known_how_far_each_reader_and_each_topic_has_got() {
        let mut judge = judge(&[(1, message(4)), (2, message(9))]);
        assert_eq!(judge.newest_of(Life(1), 1), Some(4));
        assert_eq!(judge.newest(1), Some(9));
        assert_eq!(judge.newest(2), None);
        judge.bury(Life(1));
        assert_eq!(judge.newest_of(Life(1), 1), None);
    }
}
