//! A topic's publisher.

use std::sync::Arc;

use conduit_ring::{Geometry, PublisherOptions, Topic, upkeep::Upkeep};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::bytes::Bytes;
use crate::loan::Loan;
use crate::publication::Publication;
use crate::{content, errors, info};

/// The publisher of a topic.
///
/// Publishing copies a message into the ring and returns. It never waits for a subscriber, and a
/// topic may have none.
///
/// >>> with Publisher("doc.temperature", content="text/plain") as publisher:
/// ...     publisher.publish(b"21.5")
/// 0
///
/// Parameters
/// ----------
/// topic : str
///     The topic's name: 1 to 200 characters of ``A-Z a-z 0-9 _ . -``.
/// slot_count, slot_size : int, optional
///     The ring holds the last ``slot_count`` messages (a power of two) of up to
///     ``slot_size - 20`` bytes. Its memory is allocated now. The default is 16 slots of 4096
///     bytes.
/// depth, max_message_size : int, optional
///     The same in other numbers: ``depth`` messages of up to ``max_message_size`` bytes.
/// content : str or int, optional
///     The encoding of the messages, so that tools can decode them; ``None`` for raw bytes.
/// mode : int
///     The permissions of the topic's file, independent of the umask.
/// force : bool
///     Replace a foreign file even if a process may use it.
///
/// Raises
/// ------
/// PublisherAliveError
///     While another publisher of the topic is alive.
/// ValueError
///     For an invalid name or size.
/// OSError
///     With ``ENOSPC`` if /dev/shm is full.
///
/// Notes
/// -----
/// If the topic's publisher died, the new one takes the topic over where it stopped, unnoticed by
/// subscribers.
///
/// If the topic's file is removed, the publisher creates it again within a second, with
/// continuous sequence numbers, even while nothing is published. A thread checks it four times
/// per second.
///
/// Leaving a ``with`` block closes the topic. Threads may share a publisher. A forked child
/// cannot use its parent's.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Publisher {
    topic: Topic,
    geometry: Geometry,
    /// The thread that checks the topic's name.
    _upkeep: Option<Upkeep>,
    publication: Arc<Publication>,
}

#[pymethods]
impl Publisher {
    #[new]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments of Python")]
    #[pyo3(
        signature = (
            topic, *, slot_count=None, slot_size=None, depth=None, max_message_size=None,
            content=None, mode=0o660, force=false
        ),
        text_signature = "(topic, *, slot_count=16, slot_size=4096, depth=None, \
                          max_message_size=None, content=None, mode=0o660, force=False)"
    )]
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
        let publication = Arc::new(Publication::new(publisher));
        let watched = publication.clone();
        Ok(Publisher {
            topic,
            geometry,
            _upkeep: Upkeep::start(move || watched.check_name()).ok(),
            publication,
        })
    }

    /// Publish one message.
    ///
    /// Parameters
    /// ----------
    /// message, *more : buffer
    ///     Contiguous objects with the buffer protocol: ``bytes``, ``bytearray``, ``memoryview``,
    ///     ``array.array``, a numpy array, a :class:`Message`. Several are joined to one message,
    ///     each copied directly into the ring: ``publisher.publish(header, pixels)``.
    ///
    /// Returns
    /// -------
    /// int
    ///     The message's sequence number.
    ///
    /// Raises
    /// ------
    /// MessageTooLargeError
    ///     If the message does not fit into a slot.
    /// SlotHeldError
    ///     If leases of subscribers hold all slots. Nothing is published, and the next message
    ///     gets the number.
    /// NameLostError
    ///     If the topic's file was removed and another publisher has its name.
    /// ClosedError
    ///     After :meth:`close`.
    /// TypeError
    ///     For an object without the buffer protocol.
    /// ValueError
    ///     For an array that is not contiguous.
    /// RuntimeError
    ///     While a loan is outstanding.
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
            return self.publication.publish(py, &[unsafe { first.as_slice() }]);
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
        self.publication.publish(py, &parts)
    }

    /// Lend the next slot, in which a message of ``size`` bytes is written in place.
    ///
    /// For large messages. Leaving the ``with`` block publishes the message, unless an exception
    /// leaves it.
    ///
    /// >>> with publisher.loan(480 * 640) as loan:                        # doctest: +SKIP
    /// ...     render_into(loan.array("uint8", (480, 640)))
    ///
    /// Returns
    /// -------
    /// Loan
    ///     See there for its state after the block.
    ///
    /// Raises
    /// ------
    /// RuntimeError
    ///     On entering, while another loan is outstanding. Publishing raises it during a loan
    ///     too. The other exceptions are those of :meth:`publish`.
    fn loan(slf: Py<Self>, size: usize) -> Loan {
        let publication = slf.get().publication.clone();
        Loan::new(slf.into_any(), publication, size)
    }

    /// Return the state of the topic as a :class:`TopicInfo`.
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let info = self.publication.info(py)?;
        info::to_python(py, &info)
    }

    /// End the topic.
    ///
    /// Subscribers read the remaining messages and are then notified. Further calls have no
    /// effect.
    fn close(&self, py: Python<'_>) {
        py.detach(|| self.publication.close());
    }

    /// The topic's name.
    #[getter]
    fn topic(&self) -> &str {
        self.topic.name()
    }

    /// The number of messages that the ring holds.
    #[getter]
    fn slot_count(&self) -> u32 {
        self.geometry.slot_count()
    }

    /// The largest size of a message in bytes.
    #[getter]
    fn max_message_size(&self) -> usize {
        self.geometry.max_message_size()
    }

    /// Whether the publisher is closed.
    #[getter]
    fn closed(&self, py: Python<'_>) -> bool {
        self.publication.is_closed(py)
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

/// Closes a publisher that is garbage collected. Its thread shares the publication, and ends
/// after this.
impl Drop for Publisher {
    fn drop(&mut self) {
        self.publication.close();
    }
}

/// Returns the geometry of slots with their header, or of messages without it.
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
                "expected slot_count and slot_size, or depth and max_message_size, \
                 got: some of both",
            ));
        }
    };
    geometry.map_err(errors::of_ring)
}

fn number(name: &str, given: Option<i64>, default: u32) -> PyResult<u32> {
    let Some(given) = given else {
        return Ok(default);
    };
    u32::try_from(given).map_err(|_| {
        PyValueError::new_err(format!(
            "invalid {name}: expected a number from 0 to {}, got: {given}",
            u32::MAX
        ))
    })
}
