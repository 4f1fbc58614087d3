//! Writing a message where it will be read.

use std::fmt;
use std::io;
use std::sync::Arc;

use crate::copy;
use crate::memory::Memory;
use crate::publication::Publication;

/// A slot that is being filled: see [`Publisher::loan`](crate::Publisher::loan).
///
/// [`Loan::commit`] publishes the message. A loan that is dropped publishes nothing, and the next
/// message takes the same slot and number.
///
/// Until they are overwritten, the slot has the bytes of older messages. A message that is
/// committed with gaps shows them.
///
/// # Why there is no slice
///
/// Readers may be copying from the slot while it is written; what they copy they reject. Rust
/// allows no `&mut [u8]` over such memory. So the slot is written through [`Loan::write_at`],
/// through [`io::Write`] (one part after another) or through a raw pointer.
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
    publication: &'a mut Publication,
    len: usize,
    /// Where [`io::Write`] continues.
    at: usize,
}

impl<'a> Loan<'a> {
    pub(crate) fn new(publication: &'a mut Publication, len: usize) -> Loan<'a> {
        Loan {
            publication,
            len,
            at: 0,
        }
    }

    /// Returns the length of the message in bytes.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether the message has no bytes.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns the sequence number that the message will have.
    pub fn sequence(&self) -> u64 {
        self.publication.next_sequence()
    }

    /// Shortens the message to `len` bytes. It never makes the message longer.
    pub fn truncate(&mut self, len: usize) {
        self.len = self.len.min(len);
    }

    /// Copies `part` to the bytes from `at` on.
    ///
    /// # Panics
    /// Panics if the message ends before `at + part.len()`.
    pub fn write_at(&mut self, at: usize, part: &[u8]) {
        assert!(
            at <= self.len && part.len() <= self.len - at,
            "expected a part inside the message of {} bytes, got: {} bytes from {at} on",
            self.len,
            part.len()
        );
        let to = self.as_mut_ptr().wrapping_add(at);
        // SAFETY: the slot has these bytes by the assertion, the source is a slice of this
        // process's own.
        unsafe { copy::into_shared(part.as_ptr(), to, part.len()) };
    }

    /// Returns the address of the message: [`Loan::len`] bytes of any alignment, writable until
    /// the loan is committed or dropped.
    ///
    /// For code that takes a pointer, such as a driver's `read` or C. Do not make a `&mut [u8]`
    /// of it: other processes may read these bytes, and in bad faith write them, at any time.
    pub fn as_mut_ptr(&mut self) -> *mut u8 {
        self.publication.payload()
    }

    /// Publishes the message and returns its sequence number.
    ///
    /// In a child of the process that borrowed the slot, it publishes nothing.
    pub fn commit(self) -> u64 {
        self.publication.commit(self.len)
    }

    /// Returns the loan without its borrow of the publisher, for code that cannot keep a borrow,
    /// such as bindings of other languages. [`SuspendedLoan::resume`] takes it up again.
    pub fn suspend(self) -> SuspendedLoan {
        SuspendedLoan {
            memory: self.publication.shared_memory().clone(),
            sequence: self.sequence(),
            len: self.len,
        }
    }
}

/// A loan to be taken up again: see [`Loan::suspend`].
///
/// ```
/// use conduit_ring::{Publisher, PublisherOptions, Topic};
///
/// # let name = format!("doc-suspended-{}", std::process::id());
/// let mut publisher = Publisher::open(&Topic::new(&name)?, &PublisherOptions::default())?;
/// let suspended = publisher.loan(4)?.suspend();
/// let mut loan = suspended.resume(&mut publisher).expect("nothing was published meanwhile");
/// loan.write_at(0, b"late");
/// assert_eq!(loan.commit(), 0);
/// assert!(suspended.resume(&mut publisher).is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SuspendedLoan {
    memory: Arc<Memory>,
    sequence: u64,
    len: usize,
}

impl SuspendedLoan {
    /// As `SuspendedLoan::resume`, for the private half of a publisher.
    pub(crate) fn resume_on<'a>(&self, publication: &'a mut Publication) -> Option<Loan<'a>> {
        let is_same = Arc::ptr_eq(&self.memory, publication.shared_memory())
            && self.sequence == publication.next_sequence();
        is_same.then(|| Loan::new(publication, self.len))
    }

    /// Returns the address of the message, as [`Loan::as_mut_ptr`] does.
    ///
    /// The memory stays mapped as long as this value lives, even when the publisher does not. But
    /// once the publisher has published or lent again, a write there damages messages.
    pub fn as_mut_ptr(&self) -> *mut u8 {
        self.memory.slot(self.sequence).payload()
    }

    /// Returns the sequence number that the message will have.
    pub fn sequence(&self) -> u64 {
        self.sequence
    }

    /// Returns the length of the message in bytes.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether the message has no bytes.
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
    /// Writes as much as there is room for, behind the bytes that earlier calls wrote.
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
