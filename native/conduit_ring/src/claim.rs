//! The 16 reader lines: taking one, giving it up, and taking back those whose readers died.
//!
//! A line is held by a lock, which the kernel frees when its reader dies; the bits only tell the writer about it. Bits of
//! a native line change under its lock alone. A legacy reader has no lock: it sets its bit of `subscriber_mask` and then
//! writes its `read_idx`. Hence the order in which a native line is given up: native, waiting and pin bits first (a legacy
//! successor of the bit must not be taken for native, or it would not be woken), then `read_idx` is made invalid, then the
//! mask bit goes, then `claim_id`. Lines of a new segment begin with such a `read_idx`. Hence whatever step a native reader
//! was killed at, what it left is told from a legacy claim: by its native bit, or by a `claim_id` beside an invalid
//! `read_idx`. (One case errs on the safe side and is left to a person: killed in the midst of claiming a line that a
//! legacy reader had before.)

use std::io;

use crate::layout::{NATIVE_MASK, PIN_MASK, ReaderLine, SUBSCRIBER_MASK, WAITING_MASK};
use crate::memory::Memory;
use crate::reader::{self, Source};
use crate::sync::Ordering::{AcqRel, Acquire, Relaxed, Release};

/// `read_idx` of a line that has not been claimed yet, or that a native reader is giving up.
const GIVEN_UP: u64 = u64::MAX;

/// The locks on reader lines.
pub(crate) trait LineLocks {
    /// `false` when another one has it.
    fn try_lock(&self, line: ReaderLine) -> io::Result<bool>;
    fn unlock(&self, line: ReaderLine) -> io::Result<()>;
}

/// Who claims, for people to read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Claimant {
    /// Random, so that a claim can be recognised.
    pub(crate) id: u64,
    pub(crate) pid: u32,
    pub(crate) start_time: u64,
}

/// A reader line that is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Claim {
    pub(crate) line: ReaderLine,
    pub(crate) id: u64,
}

impl Claim {
    /// Takes a line, those of dead readers included; `None` when all are held.
    pub(crate) fn take(
        memory: &Memory,
        locks: &impl LineLocks,
        who: Claimant,
    ) -> io::Result<Option<Claim>> {
        reclaim_leaked(memory, locks)?;
        for line in ReaderLine::all() {
            if is_set(memory, line) || !locks.try_lock(line)? {
                continue;
            }
            if take_free(memory, line, who) {
                return Ok(Some(Claim { line, id: who.id }));
            }
            locks.unlock(line)?;
        }
        Ok(None)
    }

    /// Whether the segment still says so; a legacy publisher may have started it anew.
    pub(crate) fn stands(&self, memory: &Memory) -> bool {
        memory.u64(self.line.claim_id()).load(Relaxed) == self.id
            && memory.u32(NATIVE_MASK).load(Relaxed) & self.line.bit() != 0
            && is_set(memory, self.line)
    }

    /// Gives the line up if it still is this claim's, and its lock in any case.
    pub(crate) fn release(self, memory: &Memory, locks: &impl LineLocks) -> io::Result<()> {
        if self.stands(memory) {
            clear(memory, self.line);
        }
        locks.unlock(self.line)
    }
}

/// Prepares the lines of a new segment.
pub(crate) fn prepare(memory: &Memory) {
    ReaderLine::all().for_each(|line| memory.u64(line.read_idx()).store(GIVEN_UP, Relaxed));
}

/// Gives up every line whose native reader died. The caller holds no line.
pub(crate) fn reclaim_leaked(memory: &Memory, locks: &impl LineLocks) -> io::Result<()> {
    for line in ReaderLine::all() {
        let leaked = is_native_claim(memory, line) || waits_unclaimed(memory, line);
        if leaked && locks.try_lock(line)? {
            if is_native_claim(memory, line) {
                clear(memory, line);
            } else {
                memory.u32(WAITING_MASK).fetch_and(!line.bit(), Relaxed);
            }
            locks.unlock(line)?;
        }
    }
    Ok(())
}

/// Takes the pins of those of these lines (bits) whose readers died; whether there was one.
pub(crate) fn reclaim_pins(
    memory: &Memory,
    locks: &impl LineLocks,
    lines: u32,
) -> io::Result<bool> {
    let mut reclaimed = false;
    for line in ReaderLine::all().filter(|line| lines & line.bit() != 0) {
        if !locks.try_lock(line)? {
            continue;
        }
        if is_native_claim(memory, line) {
            clear(memory, line);
        } else {
            memory.u32(PIN_MASK).fetch_and(!line.bit(), Relaxed);
        }
        locks.unlock(line)?;
        reclaimed = true;
    }
    Ok(reclaimed)
}

/// Takes a line whose lock is held and whose bit was clear; `false` when a legacy reader was quicker.
fn take_free(memory: &Memory, line: ReaderLine, who: Claimant) -> bool {
    memory.u32(WAITING_MASK).fetch_and(!line.bit(), Relaxed);
    memory.u32(PIN_MASK).fetch_and(!line.bit(), Relaxed);
    memory.u64(line.claim_id()).store(who.id, Relaxed);
    // AcqRel: meets the Release in clear and the Acquire in is_set.
    if memory.u32(SUBSCRIBER_MASK).fetch_or(line.bit(), AcqRel) & line.bit() != 0 {
        memory.u64(line.claim_id()).store(0, Relaxed);
        return false;
    }
    memory.u32(NATIVE_MASK).fetch_or(line.bit(), Relaxed);
    memory
        .u64(line.read_idx())
        .store(reader::published(memory), Relaxed);
    memory.u32(line.pid()).store(who.pid, Relaxed);
    memory.u64(line.start_time()).store(who.start_time, Relaxed);
    memory.u64(line.lost_count()).store(0, Relaxed);
    line.pins()
        .into_iter()
        .for_each(|pin| memory.u64(pin).store(0, Relaxed));
    true
}

fn clear(memory: &Memory, line: ReaderLine) {
    memory.u32(NATIVE_MASK).fetch_and(!line.bit(), Relaxed);
    memory.u32(WAITING_MASK).fetch_and(!line.bit(), Relaxed);
    memory.u32(PIN_MASK).fetch_and(!line.bit(), Relaxed);
    memory.u64(line.read_idx()).store(GIVEN_UP, Relaxed);
    // Release: meets the acquiring claim of a legacy successor, and fetch_or in take_free.
    memory.u32(SUBSCRIBER_MASK).fetch_and(!line.bit(), Release);
    memory.u64(line.claim_id()).store(0, Relaxed);
}

fn is_set(source: &impl Source, line: ReaderLine) -> bool {
    source.load32(SUBSCRIBER_MASK, Acquire) & line.bit() != 0
}

/// What a guarded reader that sleeps looks like: it claims nothing but the lock.
fn waits_unclaimed(memory: &Memory, line: ReaderLine) -> bool {
    memory.u32(WAITING_MASK).load(Relaxed) & line.bit() != 0 && !is_set(memory, line)
}

/// Whether a set bit was set by a native reader, be it in the midst of claiming or giving up.
pub(crate) fn is_native_claim(source: &impl Source, line: ReaderLine) -> bool {
    let native = source.load32(NATIVE_MASK, Relaxed) & line.bit() != 0;
    let giving_up = source.load(line.claim_id(), Relaxed) != 0
        && source.load(line.read_idx(), Relaxed) == GIVEN_UP;
    is_set(source, line) && (native || giving_up)
}
