//! Counts reader slots that no reader has and none can get.

use std::thread;
use std::time::{Duration, Instant};

use conduit_ring::{Error, Info, State, Subscriber, SubscriberOptions};

use crate::processes::Processes;

/// The number of reader slots of a topic.
const SLOTS: usize = 16;
const RETRY_PAUSE: Duration = Duration::from_millis(100);

/// Returns the number of leaked slots of a topic. Opens as many subscribers as possible: together
/// with the live readers there must be sixteen. The first one's claim reclaims the slots of dead
/// readers; no doctor runs.
pub fn count(processes: &Processes, number: usize, patience: Duration) -> Result<u64, Error> {
    let topic = processes.topic(number)?;
    let deadline = Instant::now() + patience;
    loop {
        match Info::read(&topic) {
            // The topic's publisher was ended while it was between two segments.
            Err(Error::NoTopic { .. }) => return Ok(0),
            Ok(info) if !matches!(info.state, State::Live | State::Dead) => return Ok(0),
            _ => {}
        }
        let mut opened = Vec::new();
        while let Ok(subscriber) = Subscriber::open(&topic, &SubscriberOptions::default()) {
            opened.push(subscriber);
            if opened.len() > SLOTS {
                break;
            }
        }
        let missing = SLOTS.abs_diff(opened.len() + processes.live_readers(number));
        if missing == 0 || Instant::now() > deadline {
            return Ok(missing as u64);
        }
        // A reader may be moving from one segment to the next.
        drop(opened);
        thread::sleep(RETRY_PAUSE);
    }
}
