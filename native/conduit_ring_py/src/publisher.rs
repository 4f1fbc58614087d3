//! A topic's publisher.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use conduit_ring::{
    Geometry, PublishError, PublisherOptions, SuspendedLoan, Topic, upkeep::Upkeep,
};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::bytes::Bytes;
use crate::fork::{Birth, Own};
use crate::loan::Loan;
use crate::{content, errors, info};

/// From so many bytes on, other Python threads run while a message is copied.
const WORTH_DETACHING: usize = 64 * 1024;

/// The one publisher of a topic.
///
/// Publishing copies the message into the ring and returns: it never waits for a subscriber, and there need not be one.
///
/// >>> with Publisher("doc.temperature", content="text/plain") as publisher:
/// ...     publisher.publish(b"21.5")
/// 0
///
/// The ring holds the last ``slot_count`` messages (a power of two) of up to ``slot_size - 20`` bytes each; or say it as
/// ``depth`` messages of up to ``max_message_size`` bytes. Memory for all of it is taken now: 16 slots of 4096 bytes unless
/// told. ``content`` names the encoding of the messages, so that tools can decode them; ``None`` is raw bytes. ``mode`` is
/// the file's permissions, whatever the umask. ``force`` replaces a file that is not ours although a process may use it.
///
/// If a publisher of this topic died, its topic is taken over where it left it, and subscribers go on without noticing.
///
/// Raises :class:`PublisherAliveError` while another publisher of the topic lives, ``ValueError`` for a wrong name or size,
/// and ``OSError`` (``ENOSPC``) if /dev/shm is full.
///
/// A topic's file that somebody removes is made anew within a second, under the same numbers, also while nothing is
/// published: a thread looks after it four times a second.
///
/// Leaving a ``with`` block closes the topic. Threads may share a publisher; a forked child cannot use its parent's.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Publisher {
    topic: Topic,
    geometry: Geometry,
    birth: Birth,
    /// The thread that looks after the topic's name.
    _upkeep: Option<Upkeep>,
    inner: Arc<Mutex<Option<Own<Lender>>>>,
}

struct Lender {
    publisher: conduit_ring::Publisher,
    /// A loan is out: its holder writes to the next message's slot, so nothing else is published.
    has_lent: bool,
    /// The next message's number at the last look after the name.
    seen: Option<u64>,
}

#[pymethods]
impl Publisher {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    #[pyo3(signature = (topic, *, slot_count=None, slot_size=None, depth=None, max_message_size=None, content=None, mode=0o660, force=false),
           text_signature = "(topic, *, slot_count=16, slot_size=4096, depth=None, max_message_size=None, content=None, mode=0o660, force=False)")]
    fn new(
        py: Python<'_>,
        topic: &str,
        slot_count: Option<i64>,
        slot_size: Option<i64>,
        depth: Option<i64>,
        max_message_size: Option<i64>,
        content: Option<&Bound<'_, PyAny>>,
        mode: u32,
        force: bool,
    ) -> PyResult<Publisher> {
        let topic = Topic::new(topic).map_err(errors::of_ring)?;
        let options = PublisherOptions {
            geometry: geometry([slot_count, slot_size], [depth, max_message_size])?,
            content: content::of_argument(content)?,
            mode,
            force,
            ..PublisherOptions::default()
        };
        let publisher = py
            .detach(|| conduit_ring::Publisher::open(&topic, &options))
            .map_err(errors::of_ring)?;
        let geometry = publisher.geometry();
        let lender = Lender {
            publisher,
            has_lent: false,
            seen: None,
        };
        let inner = Arc::new(Mutex::new(Some(Own::new(lender))));
        let watched = inner.clone();
        Ok(Publisher {
            topic,
            geometry,
            birth: Birth::now(),
            _upkeep: Upkeep::start(move || look(&watched)).ok(),
            inner,
        })
    }

    /// Publishes one message and returns its sequence number.
    ///
    /// A message is any object with the buffer protocol whose bytes lie one behind the other: ``bytes``, ``bytearray``,
    /// ``memoryview``, ``array.array``, a numpy array, a :class:`Message`. Several are joined to one message, each copied
    /// straight into the ring: ``publisher.publish(header, pixels)``.
    ///
    /// Raises :class:`MessageTooLargeError` if it does not fit into a slot and :class:`SlotHeldError` if a subscriber's lease
    /// holds the slot (nothing is published, and the next message gets the number), ``TypeError`` for what has no bytes, ``ValueError`` for an array that is not contiguous,
    /// ``RuntimeError`` while a loan is out, :class:`NameLostError` while the topic's file was removed and another publisher has
    /// its name, :class:`ClosedError` after :meth:`close`.
    #[pyo3(signature = (message, /, *more))]
    fn publish(
        &self,
        py: Python<'_>,
        message: &Bound<'_, PyAny>,
        more: &Bound<'_, PyTuple>,
    ) -> PyResult<u64> {
        let first = Bytes::of(message)?;
        if more.is_empty() {
            // SAFETY: read once, below, while `first` lives.
            return self.publish_parts(py, &[unsafe { first.as_slice() }]);
        }
        let more: Vec<Bytes> = more
            .iter()
            .map(|part| Bytes::of(&part))
            .collect::<PyResult<_>>()?;
        let parts: Vec<&[u8]> = std::iter::once(&first)
            .chain(&more)
            // SAFETY: read once, below, while `first` and `more` live.
            .map(|part| unsafe { part.as_slice() })
            .collect();
        self.publish_parts(py, &parts)
    }

    /// Lends the next slot for a message of ``size`` bytes, to be written in place in a ``with`` block: for large ones.
    ///
    /// >>> with publisher.loan(480 * 640) as loan:                        # doctest: +SKIP
    /// ...     render_into(loan.array("uint8", (480, 640)))
    ///
    /// Leaving the block publishes it, unless by an exception. Entering raises as :meth:`publish`, and ``RuntimeError`` while
    /// another loan is out, as publishing does then. See :class:`Loan` for what holds after the block.
    fn loan(slf: Py<Self>, size: usize) -> Loan {
        Loan::of(slf, size)
    }

    /// What there is to know about the topic: a :class:`TopicInfo`.
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let info = self.with(py, |lender| lender.publisher.info())?;
        info::to_python(py, &info)
    }

    /// Ends the topic: subscribers read what is left and then learn that the publisher is gone. A second time is nothing.
    fn close(&self, py: Python<'_>) {
        if self.birth.is_here() {
            py.detach(|| drop(self.lock().take()));
        }
    }

    /// The topic's name.
    #[getter]
    fn topic(&self) -> &str {
        self.topic.name()
    }

    /// Messages that the ring holds.
    #[getter]
    fn slot_count(&self) -> u32 {
        self.geometry.slot_count()
    }

    /// The longest message that fits, in bytes.
    #[getter]
    fn max_message_size(&self) -> usize {
        self.geometry.max_message_size()
    }

    /// Whether it was closed.
    #[getter]
    fn closed(&self, py: Python<'_>) -> bool {
        !self.birth.is_here() || py.detach(|| self.lock().is_none())
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) {
        self.close(py);
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let closed = if self.closed(py) { ", closed" } else { "" };
        format!(
            "<Publisher of {:?}, {} messages of up to {} bytes{closed}>",
            self.topic.name(),
            self.slot_count(),
            self.max_message_size()
        )
    }
}

impl Publisher {
    fn publish_parts(&self, py: Python<'_>, parts: &[&[u8]]) -> PyResult<u64> {
        let publish = |lender: &mut Lender| {
            let published = lender.idle()?.publish_slices(parts);
            Ok::<_, PyErr>(lender.say(published))
        };
        let small = parts.iter().map(|part| part.len()).sum::<usize>() < WORTH_DETACHING;
        let published = if small {
            self.with(py, publish)
        } else {
            self.with_detached(py, publish)
        };
        published??
    }

    pub(crate) fn lend(&self, py: Python<'_>, size: usize) -> PyResult<SuspendedLoan> {
        let lent = self.with(py, |lender| {
            let lent = lender.idle()?.loan(size).map(|loan| loan.suspend());
            lender.has_lent = lent.is_ok();
            Ok::<_, PyErr>(lender.say(lent))
        })?;
        lent?
    }

    /// Publishes the first `len` bytes of what was lent.
    pub(crate) fn commit(&self, py: Python<'_>, loan: &SuspendedLoan, len: usize) -> PyResult<()> {
        let committed = self.with(py, |lender| {
            lender.has_lent = false;
            let mut loan = loan.resume(&mut lender.publisher)?;
            loan.truncate(len);
            Some(loan.commit())
        })?;
        match committed {
            Some(_) => Ok(()),
            None => Err(PyRuntimeError::new_err("the loan's slot is taken")),
        }
    }

    pub(crate) fn cancel(&self) {
        if self.birth.is_here()
            && let Some(lender) = self.lock().as_mut()
        {
            lender.get().has_lent = false;
        }
    }

    /// Without letting other threads run, unless one of them publishes right now.
    fn with<R: Send>(
        &self,
        py: Python<'_>,
        act: impl FnOnce(&mut Lender) -> R + Send,
    ) -> PyResult<R> {
        self.birth.check("publisher")?;
        let guard = match self.inner.try_lock() {
            Ok(guard) => guard,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return self.with_detached(py, act),
        };
        act_on(guard, act)
    }

    /// Whoever waits for the lock must not keep Python from running, or the lock's holder could wait for Python.
    fn with_detached<R: Send>(
        &self,
        py: Python<'_>,
        act: impl FnOnce(&mut Lender) -> R + Send,
    ) -> PyResult<R> {
        self.birth.check("publisher")?;
        py.detach(|| act_on(self.lock(), act))
    }

    fn lock(&self) -> MutexGuard<'_, Option<Own<Lender>>> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Garbage is closed too. The thread that looks after the name has its share, and ends after this.
impl Drop for Publisher {
    fn drop(&mut self) {
        if self.birth.is_here() {
            drop(self.lock().take());
        }
    }
}

/// Looks after the topic's name; `false` when there is nothing to look after any more.
fn look(inner: &Mutex<Option<Own<Lender>>>) -> bool {
    match inner.try_lock() {
        Ok(mut inner) => inner.as_mut().is_some_and(|lender| lender.get().look()),
        // It publishes just now, and looks by itself.
        Err(TryLockError::WouldBlock) => true,
        Err(TryLockError::Poisoned(_)) => false,
    }
}

impl Lender {
    fn look(&mut self) -> bool {
        let next = Some(self.publisher.next_sequence());
        // One that publishes looks by itself; a loan is written to the file that there is.
        if !self.has_lent && self.seen == next {
            // Whoever publishes is told; and it is tried again.
            let _ = self.publisher.look_after();
        }
        self.seen = next;
        true
    }

    /// What became of a message, with the reason where the name is lost.
    fn say<T>(&self, done: Result<T, PublishError>) -> PyResult<T> {
        done.map_err(|error| errors::of_publish(error, self.publisher.trouble()))
    }

    fn idle(&mut self) -> PyResult<&mut conduit_ring::Publisher> {
        if self.has_lent {
            return Err(PyRuntimeError::new_err(
                "a loan of this publisher is out; leave its block first",
            ));
        }
        Ok(&mut self.publisher)
    }
}

fn act_on<R>(
    mut guard: MutexGuard<'_, Option<Own<Lender>>>,
    act: impl FnOnce(&mut Lender) -> R,
) -> PyResult<R> {
    match guard.as_mut() {
        Some(lender) => Ok(act(lender.get())),
        None => Err(errors::closed("publisher")),
    }
}

/// Slots with their header or messages without it, whichever the caller counts in.
fn geometry(slots: [Option<i64>; 2], messages: [Option<i64>; 2]) -> PyResult<Geometry> {
    let default = Geometry::default();
    let geometry = match (slots, messages) {
        (_, [None, None]) => Geometry::slots(
            number("slot_count", slots[0], default.slot_count())?,
            number("slot_size", slots[1], default.slot_size())?,
        ),
        ([None, None], _) => Geometry::depth(
            number("depth", messages[0], default.slot_count())?,
            number(
                "max_message_size",
                messages[1],
                default.max_message_size() as u32,
            )?,
        ),
        _ => {
            return Err(PyValueError::new_err(
                "give slot_count and slot_size, or depth and max_message_size, not some of both",
            ));
        }
    };
    geometry.map_err(errors::of_ring)
}

fn number(name: &str, given: Option<i64>, default: u32) -> PyResult<u32> {
    let Some(given) = given else {
        return Ok(default);
    };
    u32::try_from(given)
        .map_err(|_| PyValueError::new_err(format!("{name} is {given}, which no ring can have")))
}
