//! `ganglion doctor`: finds and repairs what killed processes left in /dev/shm.

mod diagnosis;
mod finding;
mod records;
mod repairs;

use crate::options::Options;
use crate::output::Output;
use crate::verb::Verb;
use crate::{failure, process};
use conduit_ring::{Error, Info, Listing, State, Topic, nameless_publishers, repair};
use diagnosis::Case;
use finding::Finding;
use program::{Failure, Log};
use records::{FindingRecord, Summary};
use std::time::{Duration, Instant};

pub const VERB: Verb = Verb {
    name: "doctor",
    summary: "finds and repairs what killed processes left",
    help: HELP,
    takes_topic: false,
    options: &["--fix", "--keep-dead", "--prefix", "--json", "--help"],
    run,
};

const HELP: &str = "\
ganglion doctor: finds and repairs what killed processes left in /dev/shm

Usage: ganglion doctor [options]

  --fix           make the safe repairs
  --keep-dead     keep the files of dead publishers, which their successors take over
  --prefix NAME   only topics whose names start with NAME
  --json          print one JSON object per line: one for each problem and a summary
  --help          print this help

Exit status: 0 if no problem was found or all were repaired, else 1. A problem counts only if it
is found twice, 0.1 seconds apart. The ring works in spite of all of these problems; they use
memory and reader slots.

The problems, and what --fix does about each:

  leaked_slots      Reader slots of dead readers. Reclaimed, each under its lock, as the next
                    subscriber would do. No other repair touches a topic with a live publisher.
  publisher_dead    The file of a dead publisher. A legacy publisher counts as dead if only our
                    readers, or no process, have its file open. Removed if no process has the
                    file open or mapped. Left while a reader waits in it for the next publisher,
                    or if its users cannot be determined.
  ended             The file of a topic that was closed or replaced. Removed as above.
  damaged           A file that was a ring, or was to become one, and is not. Removed as above,
                    and only if it shows that it was one: by the ring's magic number, a valid
                    geometry or a header of zeros.
  legacy_readers    Slots of legacy readers in a file that no process has open or mapped. They
                    hold no lock, so that only an unused file proves their death. Their bits are
                    cleared.
  held_slots        Readers that hold a message for longer than a lap of the ring, such as hung
                    or stopped ones. The publisher skips the slot, and each lap skips one
                    sequence number. Reported only.
  nameless          A process that publishes in a file whose name was removed or given to
                    another file, so that no other process finds the topic. Publishers of this
                    project create the file again. One that remains cannot get its name back, is
                    silent, or is a legacy publisher. Reported only.
  foreign           Entries in the place of topics that are not rings: other files, directories,
                    symbolic links, invalid topic names, later versions and unreadable files.
                    Reported only.

The kernel knows whether a process has a file open (by a write lease), including processes of
other users and containers. It answers only a file's owner and root; for others the file counts
as in use. While a file is removed or its bits are cleared, doctor holds its publisher's lock,
so that no publisher starts there.
";

/// The time between the two examinations: longer than a publisher or reader takes to start.
const BETWEEN_EXAMINATIONS: Duration = Duration::from_millis(100);

fn run(options: &Options, output: &mut Output, _log: Log) -> Result<(), Failure> {
    let (topics, mut findings) = examine(options)?;
    if !findings.is_empty() {
        if output
            .stop()
            .wait_until(Instant::now() + BETWEEN_EXAMINATIONS)
        {
            return Ok(());
        }
        let (_, again) = examine(options)?;
        findings.retain(|finding| again.contains(finding));
    }
    let mut summary = Summary::new(topics, options.fix);
    for finding in findings {
        let outcome = options.fix.then(|| repairs::repair(&finding));
        summary.count(outcome.as_ref());
        output.put(&FindingRecord { finding, outcome })?;
    }
    output.put(&summary)?;
    summary.verdict()
}

/// Returns the number of topics and their problems.
fn examine(options: &Options) -> Result<(usize, Vec<Finding>), Failure> {
    let listing = Listing::read().map_err(failure::runtime)?;
    let selected = |topic: &Topic| topic.name().starts_with(&options.prefix);
    let topics: Vec<Topic> = listing.topics.into_iter().filter(selected).collect();
    let count = topics.len();
    let cases = topics.into_iter().filter_map(read_case);
    let mut findings: Vec<Finding> = cases
        .flat_map(|case| diagnosis::diagnose(&case, options.keep_dead))
        .collect();
    let nameless = nameless_publishers().into_iter();
    findings.extend(
        nameless
            .filter(|found| selected(&found.topic))
            .map(Finding::nameless),
    );
    if options.prefix.is_empty() {
        findings.extend(listing.misnamed.into_iter().map(Finding::misnamed));
    }
    Ok((count, findings))
}

/// Reads the state of a topic, or returns `None` when it no longer exists.
fn read_case(topic: Topic) -> Option<Case> {
    let info = match Info::read(&topic) {
        Err(Error::NoTopic { .. }) => return None,
        info => info,
    };
    let is_live = info.as_ref().is_ok_and(|info| info.state == State::Live);
    let users = if is_live {
        Vec::new()
    } else {
        process::users_of(topic.path())
    };
    let is_legacy = info.as_ref().is_ok_and(|info| info.state == State::Legacy);
    let left_by_legacy =
        is_legacy && repair::is_left_by_legacy_publisher(&topic).unwrap_or(false);
    Some(Case {
        topic,
        info,
        users,
        left_by_legacy,
    })
}
