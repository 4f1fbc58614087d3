//! A message lent for the length of a block.
//!
//! The memory belongs to a [`Loan`], which whatever shows it keeps alive: an array that outlives the block keeps looking at
//! its own message, never at another one. A loan is a copy now; once it is a held slot of the ring, nothing else changes.

use std::ffi::c_int;
use std::mem;
use std::sync::{Arc, Mutex, PoisonError};

use conduit_ring::Meta;
use pyo3::exceptions::PyValueError;
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyMemoryView, PyTuple};

use crate::bytes;
use crate::errors::LeaseLimitError;
use crate::message;
use crate::subscriber::Subscriber;
use crate::timeout::Deadline;

/// Leases of one subscriber at once.
const LIMIT: usize = 3;

/// A subscriber's buffers: those at rest, and how many are out.
#[derive(Default)]
pub(crate) struct Pool {
    state: Mutex<PoolState>,
}

#[derive(Default)]
struct PoolState {
    at_rest: Vec<Vec<u8>>,
    out: usize,
}

impl Pool {
    fn change<R>(&self, act: impl FnOnce(&mut PoolState) -> R) -> R {
        act(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn take(self: &Arc<Self>) -> PyResult<(Loan, Ticket)> {
        let taken = self.change(|state| {
            let is_free = state.out < LIMIT;
            state.out += usize::from(is_free);
            is_free.then(|| state.at_rest.pop().unwrap_or_default())
        });
        let bytes = taken.ok_or_else(|| {
            LeaseLimitError::new_err(format!(
                "{LIMIT} leases of this subscriber are held already; leave one of their blocks first"
            ))
        })?;
        let pool = Arc::clone(self);
        Ok((Loan { bytes, pool }, Ticket(Arc::clone(self))))
    }
}

/// One of the leases that a subscriber may have at once.
struct Ticket(Arc<Pool>);

impl Drop for Ticket {
    fn drop(&mut self) {
        self.0.change(|state| state.out -= 1);
    }
}

/// The memory of one lease. It is used again when nothing shows it any more.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Loan {
    bytes: Vec<u8>,
    pool: Arc<Pool>,
}

#[pymethods]
impl Loan {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        // SAFETY: Python calls it; a loan's bytes do not change or move once it is an object.
        unsafe { bytes::show(slf.as_any(), &slf.get().bytes, view, flags) }
    }
}

impl Drop for Loan {
    fn drop(&mut self) {
        let bytes = mem::take(&mut self.bytes);
        self.pool.change(|state| {
            if state.at_rest.len() < LIMIT {
                state.at_rest.push(bytes);
            }
        });
    }
}

/// A message lent for the length of a ``with`` block, from :meth:`Subscriber.lease`.
///
/// At the block's end the lease is over: :attr:`data`, :meth:`array` and :meth:`tobytes` raise ``ValueError`` then, and so
/// does a ``memoryview`` from :attr:`data`. A numpy array cannot be made to raise: one that you keep beyond the block stays
/// what it is and never shows another message, but the memory is its own then, and the next lease has to get new. So
/// compute inside the block. A subscriber has at most three leases at once.
///
/// What it costs today: one copy out of the ring into a buffer that is used again and again, so nothing is allocated or
/// zeroed for a message, and no copy beyond that one. The block is drawn such that it can become a view of the ring's own
/// memory, without that copy and without a change to programs.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Lease {
    subscriber: Py<Subscriber>,
    timeout: Option<f64>,
    stage: Mutex<Stage>,
}

enum Stage {
    Before,
    Held {
        loan: Py<Loan>,
        meta: Meta,
        views: Vec<Py<PyMemoryView>>,
        _ticket: Ticket,
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

    /// The message as a read-only ``memoryview``, which ends with the block.
    #[getter]
    fn data(&self, py: Python<'_>) -> PyResult<Py<PyMemoryView>> {
        let loan = self.loan(py)?;
        let view = PyMemoryView::from(loan.bind(py).as_any())?.unbind();
        self.held(|_, _, views| views.push(view.clone_ref(py)))?;
        Ok(view)
    }

    /// A copy of the message, to be kept.
    fn tobytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.loan(py)?.get().bytes))
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
        let loan = self.loan(py)?;
        message::array(loan.bind(py).as_any(), dtype, shape, offset)
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
        let (mut loan, ticket) = subscriber.leases().take()?;
        let deadline = Deadline::after(slf.timeout)?;
        let meta = subscriber.next_message(py, &mut loan.bytes, deadline)?;
        let held = Stage::Held {
            loan: Py::new(py, loan)?,
            meta,
            views: Vec::new(),
            _ticket: ticket,
        };
        *slf.lock() = held;
        Ok(slf)
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, PyTuple>) {
        let stage = mem::replace(&mut *self.lock(), Stage::Over);
        if let Stage::Held { views, .. } = stage {
            for view in views {
                // Refused while an array looks through it: that keeps the loan, and with it what it looks at.
                let _ = view.call_method0(py, "release");
            }
        }
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

    fn loan(&self, py: Python<'_>) -> PyResult<Py<Loan>> {
        self.held(|loan, _, _| loan.clone_ref(py))
    }

    fn held<R>(
        &self,
        act: impl FnOnce(&Py<Loan>, &Meta, &mut Vec<Py<PyMemoryView>>) -> R,
    ) -> PyResult<R> {
        match &mut *self.lock() {
            Stage::Held {
                loan, meta, views, ..
            } => Ok(act(loan, meta, views)),
            Stage::Before => Err(PyValueError::new_err("a lease is used in a with block")),
            Stage::Over => Err(PyValueError::new_err(
                "the lease is over: its block was left",
            )),
        }
    }

    /// Held for moments, in which no Python runs.
    fn lock(&self) -> std::sync::MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
