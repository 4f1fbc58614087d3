//! The bytes of Python objects, in both directions.

use std::ffi::{CStr, c_int};
use std::marker::PhantomData;
use std::slice;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyString};

/// The bytes of an argument, kept valid for as long as this value lives.
pub(crate) enum Bytes<'py> {
    Plain(Bound<'py, PyBytes>),
    Lent(Lent<'py>),
}

impl<'py> Bytes<'py> {
    /// Borrows the bytes of a contiguous object with the buffer protocol.
    pub(crate) fn of(object: &Bound<'py, PyAny>) -> PyResult<Bytes<'py>> {
        if let Ok(bytes) = object.cast::<PyBytes>() {
            return Ok(Bytes::Plain(bytes.clone()));
        }
        let lent = Lent::by(object).map_err(|error| to_error(object, error))?;
        if has_objects(lent.format()) {
            return Err(PyTypeError::new_err(
                "expected a buffer of plain bytes, got: one with references to Python objects",
            ));
        }
        Ok(Bytes::Lent(lent))
    }

    /// Returns the bytes.
    ///
    /// # Safety
    /// No thread writes to the bytes while the slice is in use. Python does not enforce this: a
    /// caller that publishes an object while another thread writes to it publishes a mixture, as
    /// with any extension that reads a buffer.
    pub(crate) unsafe fn as_slice(&self) -> &[u8] {
        match self {
            Bytes::Plain(bytes) => bytes.as_bytes(),
            // SAFETY: the caller guarantees it.
            Bytes::Lent(lent) => unsafe { lent.as_slice() },
        }
    }
}

/// A buffer that an object lends. PyO3's own type does not support buffers without a dimension,
/// such as structures of ctypes.
pub(crate) struct Lent<'py> {
    view: Box<ffi::Py_buffer>,
    py: PhantomData<Python<'py>>,
}

impl<'py> Lent<'py> {
    fn by(object: &Bound<'py, PyAny>) -> PyResult<Lent<'py>> {
        let mut view = Box::new(ffi::Py_buffer::new());
        let flags = ffi::PyBUF_C_CONTIGUOUS | ffi::PyBUF_FORMAT;
        // SAFETY: this thread is attached to Python; the view does not move until its release.
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
        // SAFETY: a string of the exporter, valid until the buffer is released.
        unsafe { CStr::from_ptr(self.view.format) }.to_bytes()
    }

    /// Returns the bytes.
    ///
    /// # Safety
    /// As for [`Bytes::as_slice`].
    unsafe fn as_slice(&self) -> &[u8] {
        if self.view.len == 0 {
            return &[];
        }
        // SAFETY: the exporter keeps `len` contiguous bytes until the buffer is released.
        unsafe { slice::from_raw_parts(self.view.buf.cast(), self.view.len as usize) }
    }
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        // SAFETY: the lifetime ends while this thread is attached to Python; the view was filled
        // and is not used again.
        unsafe { ffi::PyBuffer_Release(&raw mut *self.view) };
    }
}

/// Returns whether a format has references to Python objects. Ignores names of fields, which are
/// between colons.
fn has_objects(format: &[u8]) -> bool {
    let types = format.split(|byte| *byte == b':').step_by(2);
    types.flatten().any(|byte| *byte == b'O')
}

fn to_error(object: &Bound<'_, PyAny>, error: PyErr) -> PyErr {
    let py = object.py();
    if !error.is_instance_of::<PyTypeError>(py) {
        return PyValueError::new_err(format!(
            "expected a contiguous message ({}); copy it with numpy.ascontiguousarray",
            error.value(py)
        ));
    }
    let hint = if object.is_instance_of::<PyString>() {
        "; encode it first"
    } else {
        ""
    };
    let kind = object.get_type().name();
    let kind = kind.map_or_else(|_| "another object".into(), |name| name.to_string());
    PyTypeError::new_err(format!(
        "expected bytes, bytearray, memoryview, a numpy array or another buffer, \
         got: {kind}{hint}"
    ))
}

/// Exports bytes of `owner` as a read-only buffer.
///
/// # Safety
/// Called by `__getbuffer__` with its `view`. The `len` bytes from `start` neither move nor
/// change while `owner` lives.
pub(crate) unsafe fn export(
    owner: &Bound<'_, PyAny>,
    start: *const u8,
    len: usize,
    view: *mut ffi::Py_buffer,
    flags: c_int,
) -> PyResult<()> {
    // SAFETY: the caller guarantees it; nothing writes to a read-only buffer.
    unsafe { fill(owner, start.cast_mut(), len, READ_ONLY, view, flags) }
}

const READ_ONLY: c_int = 1;
const WRITABLE: c_int = 0;

/// Exports bytes of `owner` as a writable buffer.
///
/// # Safety
/// As for [`export`]; and Rust has no reference to the bytes while `owner` lives.
pub(crate) unsafe fn export_writable(
    owner: &Bound<'_, PyAny>,
    start: *mut u8,
    len: usize,
    view: *mut ffi::Py_buffer,
    flags: c_int,
) -> PyResult<()> {
    // SAFETY: the caller guarantees it.
    unsafe { fill(owner, start, len, WRITABLE, view, flags) }
}

/// Fills a view.
///
/// # Safety
/// As for [`export`] or [`export_writable`].
unsafe fn fill(
    owner: &Bound<'_, PyAny>,
    start: *mut u8,
    len: usize,
    access: c_int,
    view: *mut ffi::Py_buffer,
    flags: c_int,
) -> PyResult<()> {
    let (start, len) = (start.cast(), len as ffi::Py_ssize_t);
    // SAFETY: the view is Python's and takes a reference to the owner.
    let status =
        unsafe { ffi::PyBuffer_FillInfo(view, owner.as_ptr(), start, len, access, flags) };
    if status == 0 {
        Ok(())
    } else {
        Err(PyErr::fetch(owner.py()))
    }
}
