//! Making a living publisher's file anew when its name was removed or given to another file.
//!
//! The new segment has the messages and the sequence number of the old one, and its epoch is one
//! higher. The old one is retired, so that its subscribers look at the name and follow.

use crate::attach::{self, Attached};
use crate::create::build;
use crate::error::Error;
use crate::header::Origin;
use crate::layout::{
    At64, DROPPED_PINNED, HEADER_LEN, LAST_PUBLISH, REJECTED_OVERSIZE, STATE, STATE_RETIRED,
    WAKE_COUNT, WRITE_IDX, WRITE_INTENT, WRITER_EPOCH,
};
use crate::os::{Access, Name};
use crate::sync::Ordering::{Relaxed, Release};
use crate::takeover::{ATTEMPTS, lock_named, remove_legacy, remove_unused, retire};
use crate::topic::Topic;
use crate::trust;
use crate::writer;

/// The counters that a segment made anew takes over.
const CARRIED_OVER: [At64; 6] = [
    WRITE_IDX,
    WRITE_INTENT,
    LAST_PUBLISH,
    DROPPED_PINNED,
    REJECTED_OVERSIZE,
    WAKE_COUNT,
];

/// Makes a publisher's segment anew if the topic's name does not lead to it any more. Returns
/// `None` if it does.
pub(crate) fn renew(topic: &Topic, old: &Attached) -> Result<Option<Attached>, Error> {
    for _ in 0..ATTEMPTS {
        match old.segment.name(topic.path()) {
            Ok(Name::Same) => return Ok(None),
            Ok(Name::Other) => {
                if !clear_name(topic)? {
                    continue;
                }
            }
            Ok(Name::Missing) => {}
            Err(e) => return Err(Error::os("stat", topic.path())(e)),
        }
        if let Some(renewed) = rebuild(topic, old)? {
            // Release: pairs with the Acquire in Backing::load32, so that a reader that sees the
            // state sees all messages.
            old.memory.u32(STATE).store(STATE_RETIRED, Release);
            writer::notify_all(&old.memory);
            return Ok(Some(renewed));
        }
    }
    Err(Error::PublisherAlive {
        path: topic.path().to_owned(),
        pid: 0,
    })
}

/// Removes the file that took the name of a topic, if no publisher lives in it. Returns `false`
/// when the name led to yet another file by then.
fn clear_name(topic: &Topic) -> Result<bool, Error> {
    let opened = attach::open_file(topic, Access::Write);
    let Some(found) = opened.map_err(|error| trust::explain(topic, error))? else {
        return Ok(true);
    };
    trust::require(topic, &found)?;
    if !lock_named(topic, &found)? {
        return Ok(false);
    }
    match attach::read_header(topic, &found)? {
        Ok(header) if header.origin != Origin::Legacy => {
            let attached = attach::map(topic, found, header, Access::Write, false)?;
            retire(topic, &attached)?;
        }
        Ok(header) => remove_legacy(topic, &found, header, false)?,
        Err(fault) => remove_unused(topic, &found, false, attach::bad(topic, fault))?,
    }
    Ok(true)
}

/// Makes a segment with the rights, the slots and the counters of the old one. Relaxed loads
/// suffice: this publisher alone wrote the old one.
fn rebuild(topic: &Topic, old: &Attached) -> Result<Option<Attached>, Error> {
    let (mode, group) = old
        .segment
        .access_rights()
        .map_err(Error::os("stat", topic.path()))?;
    let end = old.header.geometry.segment_len();
    build(topic, old.header, (mode, Some(group)), |segment, memory| {
        segment.copy_from(&old.segment, HEADER_LEN as u64, end)?;
        for at in CARRIED_OVER {
            memory
                .u64(at)
                .store(old.memory.u64(at).load(Relaxed), Relaxed);
        }
        let epoch = old.memory.u32(WRITER_EPOCH).load(Relaxed);
        memory
            .u32(WRITER_EPOCH)
            .store(epoch.wrapping_add(1), Relaxed);
        Ok(())
    })
}
