//! A topic's subscriber.

use std::sync::Arc;

use conduit_ring::{Error, Guard, Policy, Read, Received, Start, SubscriberOptions, Topic};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyString, PyTuple};

use crate::errors::{self, ClosedError};
use crate::lease::Lease;
use crate::message::Message;
use crate::subscription::Subscription;
use crate::timeout::Deadline;

/// A subscriber of a topic, which need not exist yet.
///
/// >>> with Publisher("doc.numbers") as publisher, Subscriber("doc.numbers") as subscriber:
/// ...     _ = publisher.publish(b"one")
/// ...     message = subscriber.recv(timeout=1.0)
/// ...     message.sequence, bytes(message), message.lost
/// (0, b'one', 0)
///
/// Parameters
/// ----------
/// topic : str
///     The topic's name.
/// start : {"new", "latest"} or ("history", n)
///     The first message, if the topic exists: the next one that is published, the newest one in
///     the ring, or the last n in the ring. A topic that does not exist yet is read from its
///     first message.
/// policy : {"all", "latest"}
///     The messages to read after falling behind: all that are still in the ring, in order, or
///     only the newest, which suits controllers and cameras.
/// guard : {"auto", "always", "never"}
///     Whether to read guarded, so that no other process can kill this one by truncating the
///     topic's file (SIGBUS); a truncated file raises :class:`BadSegmentError` instead. Guarded
///     reading needs a few system calls for each message, and leases are copies. ``"auto"``
///     reads topics of other users guarded.
///
/// Raises
/// ------
/// NoReaderSlotError
///     For a 17th subscriber of a topic.
/// ValueError
///     For an invalid argument.
///
/// Notes
/// -----
/// A subscriber outlives its publisher: when the publisher dies or closes the topic, it continues
/// with the next one. :meth:`recv` and iteration return messages only; :meth:`next_event` and
/// :meth:`events` also report when the publisher stops or starts, and :attr:`publisher_up`
/// whether there is one.
///
/// While it waits, other Python threads run and Ctrl-C works. One thread may read at a time; a
/// second one gets a ``RuntimeError``. Any thread may call :meth:`close`, which ends a wait at
/// once.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Subscriber {
    topic: Topic,
    subscription: Arc<Subscription>,
}

#[pymethods]
impl Subscriber {
    #[new]
    #[pyo3(signature = (topic, *, start=None, policy="all", guard="auto"),
           text_signature = "(topic, *, start='new', policy='all', guard='auto')")]
    fn new(
        py: Python<'_>,
        topic: &str,
        start: Option<&Bound<'_, PyAny>>,
        policy: &str,
        guard: &str,
    ) -> PyResult<Subscriber> {
        let topic = Topic::found(topic).map_err(errors::of_ring)?;
        let options = SubscriberOptions {
            start: start.map_or(Ok(Start::New), start_of)?,
            policy: policy_of(policy)?,
            guard: guard_of(guard)?,
        };
        let subscriber = py
            .detach(|| conduit_ring::Subscriber::open(&topic, &options))
            .map_err(errors::of_ring)?;
        Ok(Subscriber {
            topic,
            subscription: Arc::new(Subscription::new(subscriber)),
        })
    }

    /// Wait for the next message.
    ///
    /// Events of the publisher are skipped; see :meth:`next_event`.
    ///
    /// Parameters
    /// ----------
    /// timeout : float, optional
    ///     In seconds; ``None`` waits without a timeout, 0 returns at once.
    ///
    /// Returns
    /// -------
    /// Message
    ///     The message.
    ///
    /// Raises
    /// ------
    /// TimeoutError
    ///     After the timeout.
    /// ClosedError
    ///     If the subscriber is closed, even by another thread during the wait.
    #[pyo3(signature = (timeout=None))]
    fn recv(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<Message> {
        let deadline = Deadline::after(timeout)?;
        self.subscription.next_message(py, deadline, copy_message)
    }

    /// Return the next message if there is one, otherwise ``None``. Never waits.
    fn try_read(&self, py: Python<'_>) -> PyResult<Option<Message>> {
        self.subscription.try_message(py, copy_message)
    }

    /// Wait for the next message or event of the publisher.
    ///
    /// A publisher's death is noticed within half a second and reported after its last message.
    ///
    /// Returns
    /// -------
    /// Message or PublisherEvent
    ///     The message or event.
    ///
    /// Raises
    /// ------
    /// TimeoutError, ClosedError
    ///     As :meth:`recv`.
    #[pyo3(signature = (timeout=None))]
    fn next_event(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<Py<PyAny>> {
        let deadline = Deadline::after(timeout)?;
        match self.subscription.next_event(py, deadline, copy_message)? {
            Received::Message(_, message) => Ok(Py::new(py, message)?.into_any()),
            Received::PublisherUp => publisher_event(py, "UP"),
            _ => publisher_event(py, "DOWN"),
        }
    }

    /// Iterate over messages and events of the publisher until the subscriber is closed.
    ///
    /// >>> for event in subscriber.events():                              # doctest: +SKIP
    /// ...     if event is PublisherEvent.DOWN:
    /// ...         stop_the_motors()
    fn events(slf: Py<Self>) -> Events {
        Events { subscriber: slf }
    }

    /// Lend the next message for a ``with`` block, without a copy.
    ///
    /// For large messages.
    ///
    /// >>> with subscriber.lease(timeout=1.0) as frame:                   # doctest: +SKIP
    /// ...     brightness = frame.array("uint8", (480, 640)).mean()
    ///
    /// Returns
    /// -------
    /// Lease
    ///     Entering its block waits as :meth:`recv` does. See there for its state after the
    ///     block.
    ///
    /// Raises
    /// ------
    /// LeaseLimitError
    ///     On entering, if the subscriber holds three leases. The other exceptions are those of
    ///     :meth:`recv`.
    #[pyo3(signature = (timeout=None))]
    fn lease(slf: Py<Self>, timeout: Option<f64>) -> PyResult<Lease> {
        Deadline::after(timeout)?;
        let subscription = slf.get().subscription.clone();
        Ok(Lease::new(slf.into_any(), subscription, timeout))
    }

    /// Return the state of the topic as a :class:`TopicInfo`.
    ///
    /// Raises
    /// ------
    /// NoTopicError
    ///     While the topic does not exist.
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        crate::info::info(py, self.topic.name())
    }

    /// Release the reader slot.
    ///
    /// A wait in another thread ends at once. Further calls have no effect.
    fn close(&self, py: Python<'_>) {
        self.subscription.close(py);
    }

    /// The topic's name.
    #[getter]
    fn topic(&self) -> &str {
        self.topic.name()
    }

    /// Whether the topic had a live publisher at the last read.
    #[getter]
    fn publisher_up(&self) -> bool {
        self.subscription.publisher_up()
    }

    /// The number of delivered messages.
    #[getter]
    fn delivered(&self) -> u64 {
        self.subscription.delivered()
    }

    /// The number of lost messages: the sum of ``lost`` of all delivered messages.
    #[getter]
    fn lost(&self) -> u64 {
        self.subscription.lost()
    }

    /// Whether the subscriber is closed.
    #[getter]
    fn closed(&self) -> bool {
        self.subscription.is_closed()
    }

    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Message>> {
        end_when_closed(py, self.recv(py, None))
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) {
        self.close(py);
    }

    fn __repr__(&self) -> String {
        let state = match (self.closed(), self.publisher_up()) {
            (true, _) => "closed",
            (_, true) => "publisher up",
            _ => "no publisher",
        };
        format!(
            "<Subscriber of {:?}, {state}, {} delivered, {} lost>",
            self.topic.name(),
            self.delivered(),
            self.lost()
        )
    }
}
/// Takes the next message as a copy.
fn copy_message(subscriber: &mut conduit_ring::Subscriber) -> Result<Received<Message>, Error> {
    let mut bytes = Vec::new();
    Ok(match subscriber.try_read(&mut bytes)? {
        Read::Message(meta) => Received::Message(meta, Message { bytes, meta }),
        Read::Nothing => Received::Nothing,
        Read::PublisherUp => Received::PublisherUp,
        Read::PublisherDown => Received::PublisherDown,
    })
}

/// The iterator of :meth:`Subscriber.events`.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Events {
    subscriber: Py<Subscriber>,
}

#[pymethods]
impl Events {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        end_when_closed(py, self.subscriber.get().next_event(py, None))
    }
}

/// Ends an iteration when the subscriber is closed.
fn end_when_closed<T>(py: Python<'_>, result: PyResult<T>) -> PyResult<Option<T>> {
    match result {
        Err(error) if error.is_instance_of::<ClosedError>(py) => Ok(None),
        result => result.map(Some),
    }
}

fn publisher_event(py: Python<'_>, name: &str) -> PyResult<Py<PyAny>> {
    static EVENT: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let class = EVENT.get_or_try_init(py, || {
        let types = py.import("conduit_ring._types")?;
        Ok::<_, PyErr>(types.getattr("PublisherEvent")?.unbind())
    })?;
    class.getattr(py, name)
}

fn start_of(given: &Bound<'_, PyAny>) -> PyResult<Start> {
    let start = match given.cast::<PyString>() {
        Ok(name) => match name.to_cow()?.as_ref() {
            "new" => Some(Start::New),
            "latest" => Some(Start::Latest),
            _ => None,
        },
        Err(_) => match given.extract::<(String, u32)>() {
            Ok((name, count)) if name == "history" => Some(Start::History(count)),
            _ => None,
        },
    };
    start.ok_or_else(|| {
        let given = given.repr();
        let given = given.map_or_else(|_| "another object".into(), |text| text.to_string());
        PyValueError::new_err(format!(
            "invalid start: expected \"new\", \"latest\" or (\"history\", n) \
             with n from 0 to 4294967295, got: {given}"
        ))
    })
}

fn policy_of(given: &str) -> PyResult<Policy> {
    match given {
        "all" => Ok(Policy::All),
        "latest" => Ok(Policy::Latest),
        _ => Err(PyValueError::new_err(format!(
            "invalid policy: expected \"all\" or \"latest\", got: {given:?}"
        ))),
    }
}

fn guard_of(given: &str) -> PyResult<Guard> {
    match given {
        "auto" => Ok(Guard::Auto),
        "always" => Ok(Guard::Always),
        "never" => Ok(Guard::Never),
        _ => Err(PyValueError::new_err(format!(
            "invalid guard: expected \"auto\", \"always\" or \"never\", got: {given:?}"
        ))),
    }
}
