//! The operating system: files, locks, mappings, futexes, events, clocks and processes.
//!
//! No other module of the crate calls the operating system, and a test of the repository holds
//! that. Each file below has one subject:
//!
//! | file | subject | calls |
//! |---|---|---|
//! | `file` | an open segment file, and the names that lead to it | `open`, `linkat`, `pread`, … |
//! | `lock` | which processes live, and whether one has a file open | `F_OFD_SETLK`, `F_SETLEASE` |
//! | `mapping` | a file in memory | `mmap`, `mremap`, `munmap` |
//! | `futex` | sleeping on a word in memory | `FUTEX_WAIT`, `FUTEX_WAKE`, `FUTEX_WAKE_OP` |
//! | `event` | sleeping without such a word | `eventfd`, `inotify`, `poll` |
//! | `clock` | the time | `clock_gettime` |
//! | `process` | this process and the others | `/proc`, `pthread_atfork`, `getrandom` |
//!
//! Most calls go through [`nix`], whose functions are safe. The `unsafe` blocks that remain are
//! those for which it has no safe function: mappings, futexes, file leases, and reads into memory
//! that is not initialised. Each of them is one call with its reason.

mod clock;
mod event;
mod file;
mod futex;
mod lock;
mod mapping;
mod process;

pub(crate) use clock::{monotonic_raw_ns, realtime_ns};
pub(crate) use event::{Event, Watch, wait_for_either};
pub(crate) use file::{
    Access, FileId, FileOwner, Name, Segment, gives_group, names_in, owner_of, text_of,
};
pub(crate) use futex::{futex_wait, futex_wake_all, is_missing_page};
pub(crate) use mapping::Mapping;
#[cfg(test)]
pub(crate) use process::receives_signals;
pub(crate) use process::{
    call_in_children, has_gained_rights, maps_of, open_file_of, own_user, process_ids,
    process_start_time, random_id, start_thread,
};
