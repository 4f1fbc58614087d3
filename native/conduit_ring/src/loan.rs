//! Writing a message where it will be read.

use std::fmt;
use std::io;
use std::sync::Arc;

use crate::copy;
use crate::memory::Memory;
use crate::publisher::Publisher;

/// A slot that is being filled: see [`Publisher::loan`]. [`Loan::commit`] publishes it; dropped without that, nothing was
/// published, and the next message takes the same slot and number.
///
/// The slot has the bytes of older messages until they are overwritten: a message that is committed with gaps shows them.
///
/// The memory is shared, so that it is written through [`Loan::write_at`], [`io::Write`] (one part after another) or a raw
/// pointer, and never lent as a slice: readers may be copying from it at the same time (what they copy they reject).
///
/// ```
/// use std::io::Write;
/// use conduit_ring::{Publisher, PublisherOptions, Topic};
///
/// # let name = format!("doc-loan-{}", std::process::id());
/// let mut publisher = Publisher::open(&Topic::new(&name)?, &PublisherOptions::default())?;
/// let mut loan = publisher.loan(9)?;
/// loan.write_at(4, b", all");
/// write!(loan, "good")?;
/// assert_eq!(loan.commit(), 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Loan<'a> {
    publisher: &'a mut Publisher,
    len: usize,
    /// Where [`io::Write`] goes on.
    at: usize,
}

impl<'a> Loan<'a> {
    pub(crate) fn new(publisher: &'a mut Publisher, len: usize) -> Loan<'a> {
        Loan {
            publisher,
            len,
            at: 0,
        }
    }

    /// Length of the message in bytes.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether the message has no bytes.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The number that the message will have.
    pub fn sequence(&self) -> u64 {
        self.publisher.next_sequence()
    }

    /// Makes the message shorter, if it turned out so. Longer it does not get.
    pub fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
    }

    /// Copies `part` to the bytes from `at` on.
    ///
    /// # Panics
    /// When the message has not that many.
    pub fn write_at(&mut self, at: usize, part: &[u8]) {
        assert!(
            at <= self.len && part.len() <= self.len - at,
            "{} bytes from {at} on of a message of {}",
            part.len(),
            self.len
        );
        let to = self.as_mut_ptr().wrapping_add(at);
        // SAFETY: the slot has these bytes by the assertion, the source is a slice of this process's own.
        unsafe { copy::into_shared(part.as_ptr(), to, part.len()) };
    }

    /// Where the message is written to: [`Loan::len`] bytes, writable until the loan is committed or dropped. Of any
    /// alignment. For code that takes a pointer (a driver's `read`, C): do not make a `&mut [u8]` of it, since other
    /// processes may read these bytes, and in bad faith write them, at any time.
    pub fn as_mut_ptr(&mut self) -> *mut u8 {
        self.publisher.lent_payload()
    }

    /// Publishes the message and returns its sequence number. In a child of the process that borrowed it, nothing.
    pub fn commit(self) -> u64 {
        self.publisher.commit(self.len)
    }

    /// The loan without its borrow of the publisher, for those who cannot keep one: other languages.
    pub fn suspend(self) -> SuspendedLoan {
        SuspendedLoan {
            memory: self.publisher.shared_memory().clone(),
            sequence: self.sequence(),
            len: self.len,
        }
    }
}

/// A loan to be taken up again: see [`Loan::suspend`].
pub struct SuspendedLoan {
    memory: Arc<Memory>,
    sequence: u64,
    len: usize,
}

impl SuspendedLoan {
    /// The loan as it was. `None` when the publisher has published meanwhile, or is not the one that lent.
    pub fn resume<'a>(&self, publisher: &'a mut Publisher) -> Option<Loan<'a>> {
        let is_same = Arc::ptr_eq(&self.memory, publisher.shared_memory())
            && self.sequence == publisher.next_sequence();
        is_same.then(|| Loan::new(publisher, self.len))
    }

    /// As [`Loan::as_mut_ptr`]. The memory is there as long as this is, also when the publisher is not any more; but once it
    /// has published or lent anew, whoever still writes there damages messages.
    pub fn as_mut_ptr(&self) -> *mut u8 {
        self.memory.slot(self.sequence).payload()
    }

    /// The number that the message will have.
    pub fn sequence(&self) -> u64 {
        self.sequence
    }

    /// Length of the message in bytes.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether the message has no bytes.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

impl fmt::Debug for SuspendedLoan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SuspendedLoan")
            .field("sequence", &self.sequence)
            .field("len", &self.len)
            .finish_non_exhaustive()
    }
}

impl io::Write for Loan<'_> {
    /// Writes as much as there is room for, behind what was written so before.
    fn write(&mut self, part: &[u8]) -> io::Result<usize> {
        let at = self.at.min(self.len);
        let fits = part.len().min(self.len - at);
        self.write_at(at, &part[..fits]);
        self.at = at + fits;
        Ok(fits)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl fmt::Debug for Loan<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Loan")
            .field("sequence", &self.sequence())
            .field("len", &self.len)
            .finish_non_exhaustive()
    }
}
