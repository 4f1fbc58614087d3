//! Sleeping on a 32-bit word of a mapping until another process changes it and says so.

use std::io;
use std::ptr;
use std::sync::atomic::AtomicU32;
use std::time::Duration;

use super::mapping::Mapping;

/// The kernel's `struct timespec` of the futex call. Its fields are as wide as a register,
/// whatever libc's are.
#[repr(C)]
struct KernelTimespec {
    seconds: libc::c_long,
    nanoseconds: libc::c_long,
}

impl From<Duration> for KernelTimespec {
    fn from(timeout: Duration) -> KernelTimespec {
        KernelTimespec {
            seconds: timeout.as_secs().try_into().unwrap_or(libc::c_long::MAX),
            nanoseconds: timeout.subsec_nanos() as libc::c_long,
        }
    }
}

/// Sleeps while the word is `expected`, at most for `timeout`. May return early for no reason.
pub(crate) fn futex_wait(word: &AtomicU32, expected: u32, timeout: Duration) {
    // Every result is a reason to look again.
    let _ = wait_at(word.as_ptr(), expected, timeout);
}

/// Wakes every thread of every process that sleeps on the word, and returns how many there were.
pub(crate) fn futex_wake_all(word: &AtomicU32) -> u32 {
    let word = word.as_ptr();
    // SAFETY: the kernel takes the word's address to find its sleepers, and does not touch it.
    let woken = unsafe { libc::syscall(libc::SYS_futex, word, libc::FUTEX_WAKE, i32::MAX) };
    u32::try_from(woken).unwrap_or(0)
}

fn wait_at(word: *const u32, expected: u32, timeout: Duration) -> io::Result<()> {
    let timeout = KernelTimespec::from(timeout);
    let timeout = ptr::from_ref(&timeout);
    // SAFETY: the kernel checks the word's address, and the timeout outlives the call.
    let result =
        unsafe { libc::syscall(libc::SYS_futex, word, libc::FUTEX_WAIT, expected, timeout) };
    result_of(result)
}

fn result_of(result: libc::c_long) -> io::Result<()> {
    if result < 0 {
        Err(io::Error::last_os_error())
    } else {
        Ok(())
    }
}

/// Returns whether the kernel found no page behind a mapping: the file has become shorter.
pub(crate) fn is_missing_page(error: &io::Error) -> bool {
    error.raw_os_error() == Some(libc::EFAULT)
}

/// Operations on words that only the kernel touches. Where the file has become shorter they
/// return EFAULT, and the process gets no SIGBUS.
impl Mapping {
    /// Sleeps while the word at `offset` is `expected`, at most for `timeout`. May return early
    /// for no reason.
    pub(crate) fn futex_wait(
        &self,
        offset: usize,
        expected: u32,
        timeout: Duration,
    ) -> io::Result<()> {
        let word = self.base().wrapping_add(offset).cast::<u32>();
        match wait_at(word, expected, timeout) {
            Err(error) if is_missing_page(&error) => Err(error),
            _ => Ok(()),
        }
    }

    /// Sets a bit of the word at `offset`.
    pub(crate) fn set_bit(&self, offset: usize, bit: u32) -> io::Result<()> {
        self.wake_op(offset, 1, FUTEX_OP_OR | FUTEX_OP_SHIFT, bit)
    }

    /// Clears a bit of the word at `offset`.
    pub(crate) fn clear_bit(&self, offset: usize, bit: u32) -> io::Result<()> {
        self.wake_op(offset, 1, FUTEX_OP_ANDN | FUTEX_OP_SHIFT, bit)
    }

    /// Adds 1 to the word at `offset` and wakes all threads that sleep on it.
    pub(crate) fn bump_and_wake(&self, offset: usize) -> io::Result<()> {
        self.wake_op(offset, i32::MAX, FUTEX_OP_ADD, 1)
    }

    /// Changes the word and wakes `wake` of its sleepers. The operand has 12 bits, of which the
    /// highest is a sign: it is at most 15 here.
    fn wake_op(&self, offset: usize, wake: i32, op: u32, operand: u32) -> io::Result<()> {
        let word = self.base().wrapping_add(offset);
        let second: usize = 0;
        let change = op << 28 | operand << 12;
        let (call, wake_op) = (libc::SYS_futex, libc::FUTEX_WAKE_OP);
        // SAFETY: the kernel checks the address and changes the word as an atomic instruction
        // would; the words of this mapping are read and written by such instructions alone.
        let result = unsafe { libc::syscall(call, word, wake_op, wake, second, word, change) };
        result_of(result)
    }
}

/// The kernel's numbers, in the highest four bits of the last argument of FUTEX_WAKE_OP.
const FUTEX_OP_ADD: u32 = 1;
const FUTEX_OP_OR: u32 = 2;
const FUTEX_OP_ANDN: u32 = 3;
/// The operand is the number of a bit.
const FUTEX_OP_SHIFT: u32 = 8;
