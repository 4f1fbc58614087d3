//! Which processes have a segment mapped, as `/proc` shows it.
//!
//! Locks show which peers of this crate live. Legacy peers hold none. Their publisher is known to
//! be dead only when no process has its file mapped but readers of this crate. A process that may
//! not be inspected (on most machines some daemons may not) counts as not having it mapped: a
//! publisher among them shows itself by its next message.

use std::collections::HashMap;

use crate::claim;
use crate::layout::ReaderSlot;
use crate::os::{self, FileId, Segment};
use crate::source::Source;
use crate::sync::Ordering::Relaxed;
use crate::topic::{PREFIX, Topic, directory};

/// A mapping of a segment into a process.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Mapped {
    writable: bool,
    file: FileId,
    /// The path as the kernel shows it.
    path: String,
}

/// A process that uses a segment whose name was removed.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Nameless {
    /// The process.
    pub pid: u32,
    /// The name that the segment had.
    pub topic: Topic,
}

/// Returns the processes that publish in segments whose names were removed or given to other
/// files, as far as they can be seen.
///
/// No subscriber finds such a topic any more. Legacy peers with a removed segment are among them,
/// publishers and readers alike. A publisher of this crate gets its name back by itself, and is
/// among them for less than a second.
///
/// ```
/// use conduit_ring::nameless_publishers;
///
/// for nameless in nameless_publishers() {
///     println!("process {} publishes a lost topic: {}", nameless.pid, nameless.topic.name());
/// }
/// ```
pub fn nameless_publishers() -> Vec<Nameless> {
    let mut found = Vec::new();
    for pid in os::process_ids() {
        let maps = os::maps_of(pid);
        for mapped in maps.lines().filter_map(writable_mapping) {
            if let Some(topic) = removed_topic(&mapped.path)
                && os::open_file_of(pid, mapped.file).is_none_or(|file| is_published(&file))
            {
                found.push(Nameless { pid, topic });
            }
        }
    }
    found.dedup();
    found
}

/// Returns a process that has a legacy segment mapped as its publisher would. The process that
/// had it mapped at the last search is looked at first. `own` is a reader slot that is held
/// through this very segment.
pub(crate) fn legacy_peer(
    segment: &Segment,
    source: &impl Source,
    own: Option<ReaderSlot>,
    last: Option<u32>,
) -> Option<u32> {
    let file = segment.id().ok()?;
    let readers = native_readers(segment, source, own);
    let is_peer = |pid: &u32| {
        let maps = os::maps_of(*pid);
        let mapped = maps.lines().filter_map(writable_mapping);
        let count = mapped.filter(|mapped| mapped.file == file).count();
        count > readers.get(pid).copied().unwrap_or(0)
    };
    last.filter(is_peer)
        .or_else(|| os::process_ids().into_iter().find(is_peer))
}

/// Returns whether another process has a segment open and not mapped, as a legacy publisher has
/// it that is about to use it.
pub(crate) fn is_about_to_be_mapped(segment: &Segment) -> bool {
    let Ok(file) = segment.id() else {
        return false;
    };
    let has_mapped = |pid| {
        let maps = os::maps_of(pid);
        maps.lines().filter_map(mapping).any(|it| it.file == file)
    };
    let own = std::process::id();
    os::process_ids()
        .into_iter()
        .any(|pid| pid != own && !has_mapped(pid) && os::open_file_of(pid, file).is_some())
}

/// Returns how many readers of this crate live in each process.
fn native_readers(
    segment: &Segment,
    source: &impl Source,
    own: Option<ReaderSlot>,
) -> HashMap<u32, usize> {
    let mut readers = HashMap::new();
    let native = |&reader_slot: &ReaderSlot| claim::is_native_claim(source, reader_slot);
    for reader_slot in ReaderSlot::all().filter(native) {
        if Some(reader_slot) == own || segment.is_locked(reader_slot.lock()).unwrap_or(true) {
            *readers
                .entry(source.load32(reader_slot.pid(), Relaxed))
                .or_default() += 1;
        }
    }
    readers
}

fn is_published(segment: &Segment) -> bool {
    segment
        .is_locked(crate::layout::PUBLISHER_LOCK)
        .unwrap_or(false)
}

/// Returns the topic of a path that the kernel shows as removed.
fn removed_topic(path: &str) -> Option<Topic> {
    let name = path.strip_suffix(" (deleted)")?;
    let name = name
        .strip_prefix(directory().to_str()?)?
        .strip_prefix('/')?;
    Topic::found(name.strip_prefix(PREFIX)?).ok()
}

/// Parses a line of /proc/PID/maps that is a writable shared mapping of a file.
fn writable_mapping(line: &str) -> Option<Mapped> {
    mapping(line).filter(|mapped| mapped.writable)
}

/// Parses a line of /proc/PID/maps that is a shared mapping of a file.
fn mapping(line: &str) -> Option<Mapped> {
    let mut fields = line.splitn(6, ' ');
    let access = fields.nth(1)?;
    let (device, inode) = (fields.nth(1)?, fields.next()?.parse().ok()?);
    let (major, minor) = device.split_once(':')?;
    let number = |text| u32::from_str_radix(text, 16).ok();
    access.ends_with('s').then_some(())?;
    Some(Mapped {
        writable: access.as_bytes().get(1) == Some(&b'w'),
        file: FileId {
            device: (number(major)?, number(minor)?),
            inode,
        },
        path: fields.next().unwrap_or_default().trim_start().to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &str = "7f64a1c00000-7f64a1c11000 rw-s 00000000 00:1b 4711      \
                        /dev/shm/conduit_imu";

    #[test]
    fn a_line_of_a_writable_shared_mapping_is_parsed() {
        let file = FileId {
            device: (0, 0x1b),
            inode: 4711,
        };
        let path = "/dev/shm/conduit_imu".to_owned();
        let writable = true;
        let mapped = Mapped {
            writable,
            file,
            path,
        };
        assert_eq!(writable_mapping(LINE), Some(mapped));
    }

    #[test]
    fn other_lines_are_skipped() {
        for access in ["r--s", "rw-p", "---p", "x"] {
            assert_eq!(writable_mapping(&LINE.replace("rw-s", access)), None);
        }
        assert_eq!(writable_mapping(""), None);
        let anonymous = "7f64a1c00000-7f64a1c11000 rw-s 00000000 00:01 12";
        assert!(writable_mapping(anonymous).is_some_and(|mapped| mapped.path.is_empty()));
    }

    #[test]
    fn a_removed_segment_had_a_topic() {
        let topic = |path| removed_topic(path).map(|topic| topic.name().to_owned());
        assert_eq!(
            topic("/dev/shm/conduit_a.b (deleted)").as_deref(),
            Some("a.b")
        );
        for path in [
            "/dev/shm/conduit_a",
            "/tmp/conduit_a (deleted)",
            "/dev/shm/#12 (deleted)",
            "",
        ] {
            assert_eq!(topic(path), None);
        }
    }
}
