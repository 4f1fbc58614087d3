//! The bytes of Python's objects, in and out.

use std::ffi::{CStr, c_int};
use std::marker::PhantomData;
use std::slice;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyString};

/// The bytes of an argument, held as long as this lives.
pub(crate) enum Bytes<'py> {
    Plain(Bound<'py, PyBytes>),
    Lent(Lent<'py>),
}

impl<'py> Bytes<'py> {
    /// Of anything with the buffer protocol whose bytes lie one behind the other.
    pub(crate) fn of(object: &Bound<'py, PyAny>) -> PyResult<Bytes<'py>> {
        if let Ok(bytes) = object.cast::<PyBytes>() {
            return Ok(Bytes::Plain(bytes.clone()));
        }
        let lent = Lent::by(object).map_err(|error| refused(object, error))?;
        if has_objects(lent.format()) {
            return Err(PyTypeError::new_err(
                "Python objects have no bytes that another process could read",
            ));
        }
        Ok(Bytes::Lent(lent))
    }

    /// The bytes.
    ///
    /// # Safety
    /// Nobody writes to them while the slice is in use. Python does not hold a caller to that who publishes from one
    /// thread what another one is writing: what is published then is a mixture, as with any extension that reads a buffer.
    pub(crate) unsafe fn as_slice(&self) -> &[u8] {
        match self {
            Bytes::Plain(bytes) => bytes.as_bytes(),
            // SAFETY: as the caller promises.
            Bytes::Lent(lent) => unsafe { lent.as_slice() },
        }
    }
}

/// A buffer that an object lends. PyO3's own refuses those without a dimension, which structures of ctypes have.
pub(crate) struct Lent<'py> {
    view: Box<ffi::Py_buffer>,
    py: PhantomData<Python<'py>>,
}

impl<'py> Lent<'py> {
    fn by(object: &Bound<'py, PyAny>) -> PyResult<Lent<'py>> {
        let mut view = Box::new(ffi::Py_buffer::new());
        let flags = ffi::PyBUF_C_CONTIGUOUS | ffi::PyBUF_FORMAT;
        // SAFETY: attached to Python; the view does not move until it is released.
        let status = unsafe { ffi::PyObject_GetBuffer(object.as_ptr(), &raw mut *view, flags) };
        if status != 0 {
            return Err(PyErr::fetch(object.py()));
        }
        Ok(Lent {
            view,
            py: PhantomData,
        })
    }

    fn format(&self) -> &[u8] {
        if self.view.format.is_null() {
            return b"B";
        }
        // SAFETY: a string of the exporter's that lives until the buffer is released.
        unsafe { CStr::from_ptr(self.view.format) }.to_bytes()
    }

    /// # Safety
    /// As of [`Bytes::as_slice`].
    unsafe fn as_slice(&self) -> &[u8] {
        if self.view.len == 0 {
            return &[];
        }
        // SAFETY: the exporter keeps so many contiguous bytes there until the buffer is released.
        unsafe { slice::from_raw_parts(self.view.buf.cast(), self.view.len as usize) }
    }
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        // SAFETY: a value of this lifetime is dropped while attached to Python; the view was filled and is not used again.
        unsafe { ffi::PyBuffer_Release(&raw mut *self.view) };
    }
}

/// Whether a format has references to Python objects. Names of fields stand between colons and say nothing.
fn has_objects(format: &[u8]) -> bool {
    let types = format.split(|byte| *byte == b':').step_by(2);
    types.flatten().any(|byte| *byte == b'O')
}

fn refused(object: &Bound<'_, PyAny>, error: PyErr) -> PyErr {
    let py = object.py();
    if !error.is_instance_of::<PyTypeError>(py) {
        return PyValueError::new_err(format!(
            "the message's bytes do not lie one behind the other ({}); numpy.ascontiguousarray makes a copy that does",
            error.value(py)
        ));
    }
    let hint = if object.is_instance_of::<PyString>() {
        "; encode it first"
    } else {
        ""
    };
    let kind = object.get_type().name();
    let kind = kind.map_or_else(|_| "this".into(), |name| name.to_string());
    PyTypeError::new_err(format!(
        "a message is bytes, bytearray, memoryview, a numpy array or another buffer, not {kind}{hint}"
    ))
}

/// Shows bytes that `owner` keeps in place, for reading only.
///
/// # Safety
/// As `__getbuffer__` is called: `view` is Python's to fill. The `len` bytes from `start` stay where and as they are while `owner` lives.
pub(crate) unsafe fn show(
    owner: &Bound<'_, PyAny>,
    start: *const u8,
    len: usize,
    view: *mut ffi::Py_buffer,
    flags: c_int,
) -> PyResult<()> {
    // SAFETY: as the caller promises; nobody writes to what is read-only.
    unsafe { fill(owner, start.cast_mut(), len, READ_ONLY, view, flags) }
}

const READ_ONLY: c_int = 1;
const WRITABLE: c_int = 0;

/// Shows bytes that `owner` keeps in place, for writing too.
///
/// # Safety
/// As [`show`]; and Rust looks at the bytes by no reference while `owner` lives.
pub(crate) unsafe fn show_writable(
    owner: &Bound<'_, PyAny>,
    start: *mut u8,
    len: usize,
    view: *mut ffi::Py_buffer,
    flags: c_int,
) -> PyResult<()> {
    // SAFETY: as the caller promises.
    unsafe { fill(owner, start, len, WRITABLE, view, flags) }
}

/// # Safety
/// As [`show`] or [`show_writable`].
unsafe fn fill(
    owner: &Bound<'_, PyAny>,
    start: *mut u8,
    len: usize,
    access: c_int,
    view: *mut ffi::Py_buffer,
    flags: c_int,
) -> PyResult<()> {
    let (start, len) = (start.cast(), len as ffi::Py_ssize_t);
    // SAFETY: the view is Python's, and takes a reference to the owner.
    let status = unsafe { ffi::PyBuffer_FillInfo(view, owner.as_ptr(), start, len, access, flags) };
    if status == 0 {
        Ok(())
    } else {
        Err(PyErr::fetch(owner.py()))
    }
}
