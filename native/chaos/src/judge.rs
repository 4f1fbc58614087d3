//! Finds faults in the records of the readers.

use std::collections::{BTreeMap, HashMap};

use crate::record::Record;

/// A life of a reading process, which gets the messages of a topic in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Life(pub u64);

/// The messages of a segment: writer and checksum by sequence number.
type Numbers = HashMap<u64, (u64, u32)>;

/// The state and the findings so far.
#[derive(Debug, Default)]
pub struct Judge {
    /// Number of accepted messages.
    pub messages: u64,
    /// Number of accepted messages that differ from the published ones.
    pub torn: u64,
    /// Number of sequence numbers with two different messages, or accepted twice by one reader.
    pub reused: u64,
    /// Number of gaps in the sequence numbers that no reported loss explains.
    pub unreported: u64,
    /// Descriptions of the first findings.
    pub findings: Vec<String>,
    segments: HashMap<(u32, u64), Numbers>,
    readers: HashMap<(Life, u32), Place>,
    newest: BTreeMap<u32, u64>,
}

/// The position of a reader: the last message that it accepted.
#[derive(Clone, Copy, Debug)]
struct Place {
    instance: u64,
    sequence: u64,
    timestamp_ns: u64,
}

const MAX_FINDINGS: usize = 20;

impl Judge {
    /// Checks a record of a reader. `in_order` says whether the reader stays subscribed during
    /// its life.
    pub fn check(&mut self, life: Life, in_order: bool, record: &Record) {
        self.messages += 1;
        if !record.whole {
            self.torn += 1;
            self.record_finding(|| format!("torn: {record:?}"));
            // The next number is unknown, because this one is.
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

    /// Returns the time of publication of the last message of `topic` that `life` accepted.
    pub fn newest_of(&self, life: Life, topic: u32) -> Option<u64> {
        self.readers
            .get(&(life, topic))
            .map(|place| place.timestamp_ns)
    }

    /// Returns the time of publication of the newest accepted message of `topic`.
    pub fn newest(&self, topic: u32) -> Option<u64> {
        self.newest.get(&topic).copied()
    }

    /// Removes a dead reader.
    pub fn remove(&mut self, life: Life) {
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
            self.record_finding(|| format!("reused: {record:?} is not {known:x?}"));
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
            self.record_finding(|| format!("delivered twice: {record:?} after {before:?}"));
        } else if record.sequence != before.sequence + 1 + u64::from(record.lost) {
            self.unreported += 1;
            self.record_finding(|| format!("unreported loss: {record:?} after {before:?}"));
        }
    }

    fn record_finding(&mut self, finding: impl FnOnce() -> String) {
        if self.findings.len() < MAX_FINDINGS {
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
            judge.check(Life(*life), true, record);
        }
        judge
    }

    fn counts(judge: &Judge) -> [u64; 4] {
        [judge.messages, judge.torn, judge.reused, judge.unreported]
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
    fn two_messages_with_one_number_are_counted_for_any_readers() {
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
    fn a_message_delivered_twice_to_one_reader_is_counted() {
        assert_eq!(
            counts(&judge(&[(1, message(4)), (1, message(4))])),
            [2, 0, 1, 0]
        );
    }

    #[test]
    fn a_reader_that_subscribes_again_may_get_a_message_again() {
        let mut judge = Judge::default();
        judge.check(Life(1), false, &message(4));
        judge.check(Life(1), false, &message(4));
        assert_eq!(counts(&judge), [2, 0, 0, 0]);
    }

    #[test]
    fn an_unreported_loss_is_counted() {
        assert_eq!(
            counts(&judge(&[(1, message(4)), (1, message(6))])),
            [2, 0, 0, 1]
        );
    }

    #[test]
    fn the_newest_message_of_each_reader_and_topic_is_known() {
        let mut judge = judge(&[(1, message(4)), (2, message(9))]);
        assert_eq!(judge.newest_of(Life(1), 1), Some(4));
        assert_eq!(judge.newest(1), Some(9));
        assert_eq!(judge.newest(2), None);
        judge.remove(Life(1));
        assert_eq!(judge.newest_of(Life(1), 1), None);
    }
}
