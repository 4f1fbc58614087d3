//! A message lent for the length of a block.
//!
//! The memory belongs to a [`Held`], which whatever shows it keeps alive. When something still does at the end of the block,
//! the ring gets its slot back and it keeps the bytes at the same address: an array that outlives the block keeps
//! looking at its own message, never at another one.

use std::ffi::c_int;
use std::mem;
use std::sync::{Mutex, MutexGuard, PoisonError};

use conduit_ring::Meta;
use pyo3::exceptions::PyValueError;
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyMemoryView, PyTuple};

use crate::fork::Own;
use crate::subscriber::Subscriber;
use crate::timeout::Deadline;
use crate::{bytes, errors, message};

/// The memory of one lease.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Held {
    lease: Mutex<Own<conduit_ring::Lease>>,
}

#[pymethods]
impl Held {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let (start, len) = slf.get().with(|lease| (lease.as_ptr(), lease.len()));
        // SAFETY: Python calls it; the bytes stay at this address until the object is dropped, and as they are as long as all
        // processes that may write the topic keep to the protocol, which the documentation asks for.
        unsafe { bytes::show(slf.as_any(), start, len, view, flags) }
    }
}

impl Held {
    /// Runs no Python.
    fn with<R>(&self, act: impl FnOnce(&mut conduit_ring::Lease) -> R) -> R {
        let mut lease = self.lease.lock().unwrap_or_else(PoisonError::into_inner);
        act(lease.get())
    }
}

/// A message lent for the length of a ``with`` block, from :meth:`Subscriber.lease`.
///
/// It is not copied: ``data`` and ``array`` look at the ring itself, and the publisher leaves the slot alone meanwhile. It does
/// not wait: when it has gone round the ring and comes to this slot, it drops its *new* messages until the block is left. So
/// leave it within ``slot_count - 1`` periods of the topic. A subscriber has at most three leases at once. Where no publisher
/// would respect a hold (one without the extension, or a message that it is about to overwrite) the lease is a copy:
/// :attr:`holds_slot` tells.
///
/// At the block's end the lease is over: :attr:`data`, :meth:`array` and :meth:`tobytes` raise ``ValueError`` then, and so
/// does a ``memoryview`` from :attr:`data`. A numpy array cannot be made to raise: one that you keep beyond the block stays
/// what it is and never shows another message, at the cost of a copy when the block is left. So compute inside the block.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Lease {
    subscriber: Py<Subscriber>,
    timeout: Option<f64>,
    stage: Mutex<Stage>,
}

enum Stage {
    Before,
    Held {
        memory: Py<Held>,
        meta: Meta,
        views: Vec<Py<PyMemoryView>>,
    },
    Over,
}

#[pymethods]
impl Lease {
    /// As :attr:`Message.sequence`.
    #[getter]
    fn sequence(&self) -> PyResult<u64> {
        self.held(|_, meta, _| meta.sequence)
    }

    /// As :attr:`Message.timestamp_ns`.
    #[getter]
    fn timestamp_ns(&self) -> PyResult<u64> {
        self.held(|_, meta, _| meta.timestamp_ns)
    }

    /// As :attr:`Message.lost`.
    #[getter]
    fn lost(&self) -> PyResult<u64> {
        self.held(|_, meta, _| meta.lost)
    }

    /// Whether the publisher leaves a slot alone for it; otherwise it is a copy.
    #[getter]
    fn holds_slot(&self) -> PyResult<bool> {
        self.held(|memory, _, _| memory.get().with(|lease| lease.holds_slot()))
    }

    /// The message as a read-only ``memoryview``, which ends with the block.
    #[getter]
    fn data(&self, py: Python<'_>) -> PyResult<Py<PyMemoryView>> {
        let memory = self.memory(py)?;
        let view = PyMemoryView::from(memory.bind(py).as_any())?.unbind();
        self.held(|_, _, views| views.push(view.clone_ref(py)))?;
        Ok(view)
    }

    /// A copy of the message, to be kept.
    fn tobytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let memory = self.memory(py)?;
        memory.get().with(|lease| {
            PyBytes::new_with(py, lease.len(), |bytes| {
                lease.read_at(0, bytes);
                Ok(())
            })
        })
    }

    /// The message as a read-only numpy array, as :meth:`Message.array`, for use inside the block.
    #[pyo3(signature = (dtype=None, shape=None, *, offset=0), text_signature = "($self, dtype='uint8', shape=None, *, offset=0)")]
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
        self.held(|_, meta, _| meta.len)
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __enter__<'py>(slf: PyRef<'py, Self>, py: Python<'py>) -> PyResult<PyRef<'py, Self>> {
        if !matches!(*slf.lock(), Stage::Before) {
            return Err(PyValueError::new_err(
                "a lease is for one block; ask the subscriber for another",
            ));
        }
        let subscriber = slf.subscriber.get();
        let deadline = Deadline::after(slf.timeout)?;
        let lease = subscriber.next_of(py, deadline, conduit_ring::Subscriber::try_lease)?;
        let meta = lease.meta();
        let memory = Held {
            lease: Mutex::new(Own::new(lease)),
        };
        let held = Stage::Held {
            memory: Py::new(py, memory)?,
            meta,
            views: Vec::new(),
        };
        *slf.lock() = held;
        Ok(slf)
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) -> PyResult<()> {
        let stage = mem::replace(&mut *self.lock(), Stage::Over);
        let Stage::Held { memory, views, .. } = stage else {
            return Ok(());
        };
        for view in views {
            // Refused while something looks through it: that keeps the memory.
            let _ = view.call_method0(py, "release");
        }
        // SAFETY: an object that is held here, while attached to Python.
        let is_shown = unsafe { ffi::Py_REFCNT(memory.as_ptr()) } > 1;
        if is_shown {
            let detached = py.detach(|| memory.get().with(conduit_ring::Lease::detach));
            detached.map_err(errors::of_ring)?;
        }
        Ok(())
    }

    fn __repr__(&self) -> String {
        match &*self.lock() {
            Stage::Before => "<Lease, not begun>".to_owned(),
            Stage::Held { meta, .. } => format!(
                "<Lease of message {} of {} bytes, lost={}>",
                meta.sequence, meta.len, meta.lost
            ),
            Stage::Over => "<Lease, over>".to_owned(),
        }
    }
}

impl Lease {
    pub(crate) fn of(subscriber: Py<Subscriber>, timeout: Option<f64>) -> Lease {
        Lease {
            subscriber,
            timeout,
            stage: Mutex::new(Stage::Before),
        }
    }

    fn memory(&self, py: Python<'_>) -> PyResult<Py<Held>> {
        self.held(|memory, _, _| memory.clone_ref(py))
    }

    fn held<R>(
        &self,
        act: impl FnOnce(&Py<Held>, &Meta, &mut Vec<Py<PyMemoryView>>) -> R,
    ) -> PyResult<R> {
        match &mut *self.lock() {
            Stage::Held {
                memory,
                meta,
                views,
            } => Ok(act(memory, meta, views)),
            Stage::Before => Err(PyValueError::new_err("a lease is used in a with block")),
            Stage::Over => Err(PyValueError::new_err(
                "the lease is over: its block was left",
            )),
        }
    }

    /// Held for moments, in which no Python runs.
    fn lock(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
