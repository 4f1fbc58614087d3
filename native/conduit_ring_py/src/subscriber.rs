//! A topic's subscriber.

use std::sync::atomic::{
    AtomicBool, AtomicU64,
    Ordering::{Relaxed, SeqCst},
};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use conduit_ring::{Error, Guard, Policy, Read, Received, Start, SubscriberOptions, Topic, Waker};
use pyo3::exceptions::{PyRuntimeError, PyTimeoutError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyString, PyTuple};

use crate::errors::{self, ClosedError};
use crate::fork::{Birth, Own};
use crate::lease::Lease;
use crate::message::Message;
use crate::timeout::Deadline;

/// One reader of a topic, which need not exist yet.
///
/// >>> with Publisher("doc.numbers") as publisher, Subscriber("doc.numbers") as subscriber:
/// ...     _ = publisher.publish(b"one")
/// ...     message = subscriber.recv(timeout=1.0)
/// ...     message.sequence, bytes(message), message.lost
/// (0, b'one', 0)
///
/// ``start`` says which messages to begin with, if the topic exists: ``"new"`` (those published from now on), ``"latest"``
/// (the newest there is, then new ones) or ``("history", n)`` (the last n still there). A topic that comes into being later
/// is read from its first message. ``policy`` says what to get after falling behind: ``"all"`` that is still there, in
/// order, or only the ``"latest"``, which suits controllers and cameras.
///
/// ``guard`` says whether to read so that no other process can kill this one by cutting off the topic's file (SIGBUS): that is
/// a :class:`BadSegmentError` then. It costs a few system calls a message, and leases are copies. ``"auto"`` does so for topics
/// that belong to another user; ``"always"`` and ``"never"`` say otherwise.
///
/// It outlives its publisher: when one dies or closes, it goes on with the next by itself. :meth:`recv` and iteration give
/// messages only; :meth:`next_event` and :meth:`events` also say when the publisher goes or comes, and :attr:`publisher_up`
/// whether there is one.
///
/// While it waits, other Python threads run and Ctrl-C works. One thread reads at a time; a second one gets a
/// ``RuntimeError``. :meth:`close` may be called from any thread, and ends a wait at once.
///
/// Raises :class:`NoReaderSlotError` for a 17th subscriber of a topic, ``ValueError`` for a wrong argument.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Subscriber {
    topic: Topic,
    birth: Birth,
    waker: Waker,
    inner: Mutex<Option<Own<conduit_ring::Subscriber>>>,
    closed: AtomicBool,
    reading: AtomicBool,
    publisher_up: AtomicBool,
    delivered: AtomicU64,
    lost: AtomicU64,
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
            birth: Birth::now(),
            waker: subscriber.waker(),
            publisher_up: AtomicBool::new(subscriber.publisher_up()),
            inner: Mutex::new(Some(Own::new(subscriber))),
            closed: AtomicBool::new(false),
            reading: AtomicBool::new(false),
            delivered: AtomicU64::new(0),
            lost: AtomicU64::new(0),
        })
    }

    /// Waits for the next message and returns it.
    ///
    /// ``timeout`` is in seconds; ``None`` waits for ever, 0 only looks. Raises ``TimeoutError`` when the time is up and
    /// :class:`ClosedError` when the subscriber is closed, also by another thread. What the publisher does is passed over:
    /// see :meth:`next_event`.
    #[pyo3(signature = (timeout=None))]
    fn recv(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<Message> {
        self.next_of(py, Deadline::after(timeout)?, take_message)
    }

    /// The next message if there is one, else ``None``. Never waits.
    fn try_read(&self, py: Python<'_>) -> PyResult<Option<Message>> {
        let _turn = self.take_turn()?;
        loop {
            match self.step(py, Duration::ZERO, take_message)? {
                Received::Message(_, message) => return Ok(Some(message)),
                Received::Nothing => return Ok(None),
                Received::PublisherUp | Received::PublisherDown => {}
            }
        }
    }

    /// Waits for the next message or change of the publisher: a :class:`Message` or a :class:`PublisherEvent`.
    ///
    /// A death is noticed within half a second, and told after the last message. Raises as :meth:`recv`.
    #[pyo3(signature = (timeout=None))]
    fn next_event(&self, py: Python<'_>, timeout: Option<f64>) -> PyResult<Py<PyAny>> {
        let deadline = Deadline::after(timeout)?;
        let _turn = self.take_turn()?;
        match self.wait(py, deadline, take_message)? {
            Received::Message(_, message) => Ok(Py::new(py, message)?.into_any()),
            Received::PublisherUp => publisher_event(py, "UP"),
            _ => publisher_event(py, "DOWN"),
        }
    }

    /// Iterates over messages and changes of the publisher, as :meth:`next_event` gives them, until closed.
    ///
    /// >>> for event in subscriber.events():                              # doctest: +SKIP
    /// ...     if event is PublisherEvent.DOWN:
    /// ...         stop_the_motors()
    fn events(slf: Py<Self>) -> Events {
        Events { subscriber: slf }
    }

    /// Lends the next message for the length of a ``with`` block, where it lies in the ring: for large ones.
    ///
    /// >>> with subscriber.lease(timeout=1.0) as frame:                   # doctest: +SKIP
    /// ...     brightness = frame.array("uint8", (480, 640)).mean()
    ///
    /// Entering the block waits as :meth:`recv` does and raises as it does, and :class:`LeaseLimitError` if three leases
    /// are held already. See :class:`Lease` for what holds after the block.
    #[pyo3(signature = (timeout=None))]
    fn lease(slf: Py<Self>, timeout: Option<f64>) -> PyResult<Lease> {
        Deadline::after(timeout)?;
        Ok(Lease::of(slf, timeout))
    }

    /// What there is to know about the topic: a :class:`TopicInfo`. Raises :class:`NoTopicError` while there is none.
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        crate::info::info(py, self.topic.name())
    }

    /// Gives up the reader slot. A wait in another thread ends at once. A second time is nothing.
    fn close(&self, py: Python<'_>) {
        if !self.birth.is_here() {
            return;
        }
        self.closed.store(true, SeqCst);
        self.waker.wake();
        py.detach(|| drop(self.lock().take()));
    }

    /// The topic's name.
    #[getter]
    fn topic(&self) -> &str {
        self.topic.name()
    }

    /// Whether the topic had a live publisher when last read.
    #[getter]
    fn publisher_up(&self) -> bool {
        self.publisher_up.load(Relaxed)
    }

    /// Messages delivered so far.
    #[getter]
    fn delivered(&self) -> u64 {
        self.delivered.load(Relaxed)
    }

    /// Messages lost so far: the sum of every delivered message's ``lost``.
    #[getter]
    fn lost(&self) -> u64 {
        self.lost.load(Relaxed)
    }

    /// Whether it was closed.
    #[getter]
    fn closed(&self) -> bool {
        self.closed.load(SeqCst) || !self.birth.is_here()
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

impl Subscriber {
    /// Waits for a message and takes it by `take`.
    pub(crate) fn next_of<T: Send>(
        &self,
        py: Python<'_>,
        deadline: Deadline,
        take: Take<T>,
    ) -> PyResult<T> {
        let _turn = self.take_turn()?;
        loop {
            if let Received::Message(_, message) = self.wait(py, deadline, take)? {
                return Ok(message);
            }
        }
    }

    /// Waits for anything, in slices between which Python's signal handlers run. They may close this subscriber, so no
    /// lock is held then.
    fn wait<T: Send>(
        &self,
        py: Python<'_>,
        deadline: Deadline,
        take: Take<T>,
    ) -> PyResult<Received<T>> {
        loop {
            let slice = deadline.slice();
            match self.step(py, slice, take)? {
                Received::Nothing if slice.is_zero() => {
                    return Err(PyTimeoutError::new_err(format!(
                        "no message on {:?} in time",
                        self.topic.name()
                    )));
                }
                Received::Nothing => py.check_signals()?,
                received => return Ok(received),
            }
        }
    }

    fn step<T: Send>(
        &self,
        py: Python<'_>,
        timeout: Duration,
        take: Take<T>,
    ) -> PyResult<Received<T>> {
        let received = py.detach(|| {
            let mut guard = self.lock();
            let Some(subscriber) = guard.as_mut().filter(|_| !self.closed.load(SeqCst)) else {
                return Ok(None);
            };
            let received = take_in_time(subscriber.get(), timeout, take);
            self.publisher_up
                .store(subscriber.get().publisher_up(), Relaxed);
            received.map(Some)
        });
        let received = received
            .map_err(errors::of_ring)?
            .ok_or_else(|| errors::closed("subscriber"))?;
        if let Received::Message(meta, _) = received {
            self.delivered.fetch_add(1, Relaxed);
            self.lost.fetch_add(meta.lost, Relaxed);
        }
        Ok(received)
    }

    fn take_turn(&self) -> PyResult<Turn<'_>> {
        self.birth.check("subscriber")?;
        if self.reading.swap(true, SeqCst) {
            return Err(PyRuntimeError::new_err(
                "the subscriber is being read already, by another thread or by what a signal handler interrupted",
            ));
        }
        Ok(Turn(&self.reading))
    }

    fn lock(&self) -> MutexGuard<'_, Option<Own<conduit_ring::Subscriber>>> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How the next message is taken.
pub(crate) type Take<T> = fn(&mut conduit_ring::Subscriber) -> Result<Received<T>, Error>;

/// As a copy.
fn take_message(subscriber: &mut conduit_ring::Subscriber) -> Result<Received<Message>, Error> {
    let mut bytes = Vec::new();
    Ok(match subscriber.try_read(&mut bytes)? {
        Read::Message(meta) => Received::Message(meta, Message { bytes, meta }),
        Read::Nothing => Received::Nothing,
        Read::PublisherUp => Received::PublisherUp,
        Read::PublisherDown => Received::PublisherDown,
    })
}

/// Waits once, if there is nothing yet.
fn take_in_time<T>(
    subscriber: &mut conduit_ring::Subscriber,
    timeout: Duration,
    take: Take<T>,
) -> Result<Received<T>, Error> {
    match take(subscriber)? {
        Received::Nothing if !timeout.is_zero() => {
            subscriber.wait(timeout)?;
            take(subscriber)
        }
        received => Ok(received),
    }
}

/// The right of one thread to read.
struct Turn<'a>(&'a AtomicBool);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.store(false, SeqCst);
    }
}

/// What :meth:`Subscriber.events` gives.
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

/// An iteration over a subscriber that was closed is over.
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
        let given = given.repr().map_or_else(|_| "something else".into(), |text| text.to_string());
        PyValueError::new_err(format!(
            "start is {given}; accepted are \"new\", \"latest\" and (\"history\", n) with n from 0 to 4294967295"
        ))
    })
}

fn policy_of(given: &str) -> PyResult<Policy> {
    match given {
        "all" => Ok(Policy::All),
        "latest" => Ok(Policy::Latest),
        _ => Err(PyValueError::new_err(format!(
            "policy is {given:?}; accepted are \"all\" and \"latest\""
        ))),
    }
}

fn guard_of(given: &str) -> PyResult<Guard> {
    match given {
        "auto" => Ok(Guard::Auto),
        "always" => Ok(Guard::Always),
        "never" => Ok(Guard::Never),
        _ => Err(PyValueError::new_err(format!(
            "guard is {given:?}; accepted are \"auto\", \"always\" and \"never\""
        ))),
    }
}
