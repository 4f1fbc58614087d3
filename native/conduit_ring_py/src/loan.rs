//! A slot lent to be filled, for the length of a block.
//!
//! Whatever shows the slot's memory keeps it mapped, so that nothing that is kept beyond the block leads nowhere. That it is
//! not written to then is seen to as far as Python allows: views are released, arrays become read-only.

use std::ffi::c_int;
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Mutex, MutexGuard, PoisonError};

use conduit_ring::SuspendedLoan;
use pyo3::exceptions::{PyBufferError, PyValueError};
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyMemoryView, PyTuple};

use crate::publisher::Publisher;
use crate::{bytes, message};

/// The memory of one loan.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Slot {
    loan: SuspendedLoan,
    over: AtomicBool,
}

#[pymethods]
impl Slot {
    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let slot = slf.get();
        if slot.over.load(SeqCst) {
            return Err(PyBufferError::new_err(OVER));
        }
        let (start, len) = (slot.loan.as_mut_ptr(), slot.loan.len());
        // SAFETY: Python calls it; the bytes stay mapped as long as the slot lives, and Rust looks at them as at shared memory.
        unsafe { bytes::show_writable(slf.as_any(), start, len, view, flags) }
    }
}

const OVER: &str = "the loan is over: its block was left";

/// The next slot of a topic, lent for the length of a ``with`` block, from :meth:`Publisher.loan`.
///
/// The message is written where it will be read, without a copy of it elsewhere: ``data`` and ``array`` are writable views of
/// the ring. Leaving the block publishes it; leaving it by an exception does not, and then the next message takes the same
/// slot and number.
///
/// The slot has the bytes of older messages until they are overwritten. Meanwhile nothing else can be published, and the
/// ring's oldest message is lost to those who have not read it.
///
/// After the block :attr:`data` and :meth:`array` raise ``ValueError``, a ``memoryview`` from :attr:`data` does too, and an
/// array from :meth:`array` is read-only and shows whatever comes to be in the slot. A part of an array (``array[10:]``)
/// cannot be made so: do not write to one that you keep beyond the block, or you damage a message that was published.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Loan {
    publisher: Py<Publisher>,
    size: usize,
    stage: Mutex<Stage>,
}

enum Stage {
    Before,
    Out(Out),
    Over,
}

struct Out {
    slot: Py<Slot>,
    len: usize,
    views: Vec<Py<PyMemoryView>>,
    arrays: Vec<Py<PyAny>>,
}

#[pymethods]
impl Loan {
    /// The number that the message will have.
    #[getter]
    fn sequence(&self) -> PyResult<u64> {
        self.out(|out| out.slot.get().loan.sequence())
    }

    /// The slot's bytes as a writable ``memoryview``, which ends with the block.
    #[getter]
    fn data(&self, py: Python<'_>) -> PyResult<Py<PyMemoryView>> {
        let slot = self.slot(py)?;
        let view = PyMemoryView::from(slot.bind(py).as_any())?.unbind();
        self.out(|out| out.views.push(view.clone_ref(py)))?;
        Ok(view)
    }

    /// The slot's bytes as a writable numpy array of this type and shape, as :meth:`Message.array`. Needs numpy.
    #[pyo3(signature = (dtype=None, shape=None, *, offset=0), text_signature = "($self, dtype='uint8', shape=None, *, offset=0)")]
    fn array<'py>(
        &self,
        py: Python<'py>,
        dtype: Option<Bound<'py, PyAny>>,
        shape: Option<Bound<'py, PyAny>>,
        offset: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let slot = self.slot(py)?;
        let array = message::array(slot.bind(py).as_any(), dtype, shape, offset)?;
        self.out(|out| out.arrays.push(array.clone().unbind()))?;
        Ok(array)
    }

    /// Makes the message shorter, when it has turned out so: only the first ``size`` bytes are published.
    fn truncate(&self, size: usize) -> PyResult<()> {
        let is_shorter = self.out(|out| {
            let is_shorter = size <= out.len;
            out.len = out.len.min(size);
            is_shorter
        })?;
        if is_shorter {
            return Ok(());
        }
        Err(PyValueError::new_err(format!(
            "a loan cannot be made longer, to {size} bytes"
        )))
    }

    fn __len__(&self) -> PyResult<usize> {
        self.out(|out| out.len)
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __enter__<'py>(slf: PyRef<'py, Self>, py: Python<'py>) -> PyResult<PyRef<'py, Self>> {
        if !matches!(*slf.lock(), Stage::Before) {
            return Err(PyValueError::new_err(
                "a loan is for one block; ask the publisher for another",
            ));
        }
        let slot = Slot {
            loan: slf.publisher.get().lend(py, slf.size)?,
            over: AtomicBool::new(false),
        };
        let out = Stage::Out(Out {
            slot: Py::new(py, slot)?,
            len: slf.size,
            views: Vec::new(),
            arrays: Vec::new(),
        });
        *slf.lock() = out;
        Ok(slf)
    }

    #[pyo3(signature = (*exception))]
    fn __exit__(&self, py: Python<'_>, exception: &Bound<'_, PyTuple>) -> PyResult<()> {
        let stage = mem::replace(&mut *self.lock(), Stage::Over);
        let Stage::Out(out) = stage else {
            return Ok(());
        };
        let publisher = self.publisher.get();
        let closed = out.close(py);
        let raised = exception.get_item(0).is_ok_and(|kind| !kind.is_none());
        if raised || closed.is_err() {
            publisher.cancel();
            return closed;
        }
        publisher.commit(py, &out.slot.get().loan, out.len)
    }

    fn __repr__(&self) -> String {
        match &*self.lock() {
            Stage::Before => format!("<Loan of {} bytes, not begun>", self.size),
            Stage::Out(out) => format!(
                "<Loan of {} bytes for message {}>",
                out.len,
                out.slot.get().loan.sequence()
            ),
            Stage::Over => "<Loan, over>".to_owned(),
        }
    }
}

impl Loan {
    pub(crate) fn of(publisher: Py<Publisher>, size: usize) -> Loan {
        Loan {
            publisher,
            size,
            stage: Mutex::new(Stage::Before),
        }
    }

    fn slot(&self, py: Python<'_>) -> PyResult<Py<Slot>> {
        self.out(|out| out.slot.clone_ref(py))
    }

    fn out<R>(&self, act: impl FnOnce(&mut Out) -> R) -> PyResult<R> {
        match &mut *self.lock() {
            Stage::Out(out) => Ok(act(out)),
            Stage::Before => Err(PyValueError::new_err("a loan is used in a with block")),
            Stage::Over => Err(PyValueError::new_err(OVER)),
        }
    }

    /// Held for moments, in which no Python runs.
    fn lock(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Out {
    /// Ends the writing through what was handed out.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.slot.get().over.store(true, SeqCst);
        for view in &self.views {
            // Refused while something looks through it.
            let _ = view.call_method0(py, "release");
        }
        for array in &self.arrays {
            array.call_method1(py, "setflags", (false,))?;
        }
        Ok(())
    }
}

/// One that was entered and never left.
impl Drop for Loan {
    fn drop(&mut self) {
        if matches!(*self.lock(), Stage::Out(_)) {
            self.publisher.get().cancel();
        }
    }
}
