//! A message that is lent for reading during a `with` block.
//!
//! The memory belongs to a [`LeasedMemory`], which each view and array keeps alive. If one of
//! them exists at the end of the block, the lease is detached: the ring gets its slot back, and
//! the bytes stay at the same address. So an array that outlives the block keeps showing its own
//! message.

use std::ffi::c_int;
use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use conduit_ring::Meta;
use pyo3::exceptions::PyValueError;
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyMemoryView, PyTuple};

use crate::fork::Own;
use crate::subscription::Subscription;
use crate::timeout::Deadline;
use crate::{bytes, errors, message};

/// The memory of one lease.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct LeasedMemory {
    lease: Mutex<Own<conduit_ring::Lease>>,
}

#[pymethods]
impl LeasedMemory {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let (start, len) = slf.get().with(|lease| (lease.as_ptr(), lease.len()));
        // SAFETY: Python calls this function; the bytes stay at this address until the object is
        // dropped. They do not change as long as all processes that may write the topic follow
        // the protocol, which the documentation demands.
        unsafe { bytes::export(slf.as_any(), start, len, view, flags) }
    }
}

impl LeasedMemory {
    /// Calls `action`, which must run no Python code.
    fn with<R>(&self, action: impl FnOnce(&mut conduit_ring::Lease) -> R) -> R {
        let mut lease = self.lease.lock().unwrap_or_else(PoisonError::into_inner);
        action(lease.get())
    }
}

/// A message that is lent for a ``with`` block by :meth:`Subscriber.lease`.
///
/// The message is not copied: ``data`` and ``array`` are views of the ring, and the publisher
/// skips the slot meanwhile. It does not wait: if leases hold all slots, it drops its *new*
/// messages. So leave the block within ``slot_count - 1`` periods of the topic. A subscriber has
/// at most three leases at once. If the publisher would not respect a lease (a publisher without
/// the extension, or a message that is about to be overwritten), the lease is a copy; see
/// :attr:`holds_slot`.
///
/// The lease ends with the block. Then :attr:`data`, :meth:`array` and :meth:`tobytes` raise
/// ``ValueError``, and so does a ``memoryview`` from :attr:`data`. A numpy array cannot raise: an
/// array that you keep never shows another message, at the cost of a copy at the end of the
/// block. So compute inside the block.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Lease {
    /// Keeps the subscriber open.
    _subscriber: Py<PyAny>,
    subscription: Arc<Subscription>,
    timeout: Option<f64>,
    stage: Mutex<Stage>,
}

enum Stage {
    NotEntered,
    Leased {
        memory: Py<LeasedMemory>,
        meta: Meta,
        views: Vec<Py<PyMemoryView>>,
    },
    Ended,
}

#[pymethods]
impl Lease {
    /// As :attr:`Message.sequence`.
    #[getter]
    fn sequence(&self) -> PyResult<u64> {
        self.with_leased(|_, meta, _| meta.sequence)
    }

    /// As :attr:`Message.timestamp_ns`.
    #[getter]
    fn timestamp_ns(&self) -> PyResult<u64> {
        self.with_leased(|_, meta, _| meta.timestamp_ns)
    }

    /// As :attr:`Message.lost`.
    #[getter]
    fn lost(&self) -> PyResult<u64> {
        self.with_leased(|_, meta, _| meta.lost)
    }

    /// Whether the lease holds a slot; otherwise it is a copy.
    #[getter]
    fn holds_slot(&self) -> PyResult<bool> {
        self.with_leased(|memory, _, _| memory.get().with(|lease| lease.holds_slot()))
    }

    /// The message as a read-only ``memoryview``, which is released with the block.
    #[getter]
    fn data(&self, py: Python<'_>) -> PyResult<Py<PyMemoryView>> {
        let memory = self.memory(py)?;
        let view = PyMemoryView::from(memory.bind(py).as_any())?.unbind();
        self.with_leased(|_, _, views| views.push(view.clone_ref(py)))?;
        Ok(view)
    }

    /// Return a copy of the message, which may be kept.
    fn tobytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let memory = self.memory(py)?;
        memory.get().with(|lease| {
            PyBytes::new_with(py, lease.len(), |bytes| {
                lease.read_at(0, bytes);
                Ok(())
            })
        })
    }

    /// Return the message as a read-only numpy array, as :meth:`Message.array` does.
    ///
    /// Use it inside the block.
    #[pyo3(
        signature = (dtype=None, shape=None, *, offset=0),
        text_signature = "($self, dtype='uint8', shape=None, *, offset=0)"
    )]
    fn array<'py>(
        &self,
        py: Python<'py>,
        dtype: Option<Bound<'py, PyAny>>,
        shape: Option<Bound<'py, PyAny>>,
        offset: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let memory = self.memory(py)?;
        message::array(memory.bind(py).as_any(), dtype, shape, offset)
    }

    fn __len__(&self) -> PyResult<usize> {
        self.with_leased(|_, meta, _| meta.len)
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __enter__<'py>(slf: PyRef<'py, Self>, py: Python<'py>) -> PyResult<PyRef<'py, Self>> {
        if !matches!(*slf.lock(), Stage::NotEntered) {
            return Err(PyValueError::new_err(
                "lease was entered already; get another one from the subscriber",
            ));
        }
        let deadline = Deadline::after(slf.timeout)?;
        let take = conduit_ring::Subscriber::try_lease;
        let lease = slf.subscription.next_message(py, deadline, take)?;
        let meta = lease.meta();
        let memory = LeasedMemory {
            lease: Mutex::new(Own::new(lease)),
        };
        let leased = Stage::Leased {
            memory: Py::new(py, memory)?,
            meta,
            views: Vec::new(),
        };
        *slf.lock() = leased;
        Ok(slf)
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> PyResult<()> {
        let stage = mem::replace(&mut *self.lock(), Stage::Ended);
        let Stage::Leased { memory, views, .. } = stage else {
            return Ok(());
        };
        for view in views {
            // Fails while another object uses the view, which keeps the memory.
            let _ = view.call_method0(py, "release");
        }
        // SAFETY: `memory` keeps the object alive, and this thread is attached to Python.
        let is_used = unsafe { ffi::Py_REFCNT(memory.as_ptr()) } > 1;
        if is_used {
            let detached = py.detach(|| memory.get().with(conduit_ring::Lease::detach));
            detached.map_err(errors::of_ring)?;
        }
        Ok(())
    }

    fn __repr__(&self) -> String {
        match &*self.lock() {
            Stage::NotEntered => "<Lease, not entered>".to_owned(),
            Stage::Leased { meta, .. } => format!(
                "<Lease of message {} of {} bytes, lost={}>",
                meta.sequence, meta.len, meta.lost
            ),
            Stage::Ended => "<Lease, ended>".to_owned(),
        }
    }
}

impl Lease {
    pub(crate) fn new(
        subscriber: Py<PyAny>,
        subscription: Arc<Subscription>,
        timeout: Option<f64>,
    ) -> Lease {
        Lease {
            _subscriber: subscriber,
            subscription,
            timeout,
            stage: Mutex::new(Stage::NotEntered),
        }
    }

    fn memory(&self, py: Python<'_>) -> PyResult<Py<LeasedMemory>> {
        self.with_leased(|memory, _, _| memory.clone_ref(py))
    }

    fn with_leased<R>(
        &self,
        action: impl FnOnce(&Py<LeasedMemory>, &Meta, &mut Vec<Py<PyMemoryView>>) -> R,
    ) -> PyResult<R> {
        match &mut *self.lock() {
            Stage::Leased {
                memory,
                meta,
                views,
            } => Ok(action(memory, meta, views)),
            Stage::NotEntered => Err(PyValueError::new_err(
                "lease is not entered; use it in a with block",
            )),
            Stage::Ended => Err(PyValueError::new_err("lease has ended with its block")),
        }
    }

    /// Locks the stage. No Python code runs while the lock is held.
    fn lock(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
