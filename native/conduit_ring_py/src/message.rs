//! A message as the reader's own copy.

use std::ffi::c_int;

use conduit_ring::Meta;
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyMemoryView};

use crate::bytes;

/// A message: your own copy, which does not change as long as you keep it.
///
/// A message is a read-only buffer, so ``bytes(message)``, ``memoryview(message)``,
/// ``numpy.frombuffer(message)``, ``struct.unpack_from(format, message)`` and
/// ``file.write(message)`` all work; only ``bytes()`` copies.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Message {
    pub(crate) bytes: Vec<u8>,
    pub(crate) meta: Meta,
}

#[pymethods]
impl Message {
    /// The sequence number, which starts at 0 for a topic. A publisher that takes over a topic
    /// continues it.
    #[getter]
    fn sequence(&self) -> u64 {
        self.meta.sequence
    }

    /// The time of publication in nanoseconds of the clock of :func:`now_ns`.
    #[getter]
    fn timestamp_ns(&self) -> u64 {
        self.meta.timestamp_ns
    }

    /// The number of messages lost between the previously delivered one and this one.
    ///
    /// A message is lost when the subscriber falls behind by more than the ring holds, or when
    /// ``policy="latest"`` skips it.
    #[getter]
    fn lost(&self) -> u64 {
        self.meta.lost
    }

    /// The bytes as a read-only ``memoryview``, without a copy.
    #[getter]
    fn data(slf: &Bound<'_, Self>) -> PyResult<Py<PyMemoryView>> {
        PyMemoryView::from(slf.as_any()).map(Bound::unbind)
    }

    /// Return a copy of the bytes.
    fn tobytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.bytes)
    }

    /// Return the bytes as a read-only numpy array, without a copy. Needs numpy.
    ///
    /// Parameters
    /// ----------
    /// dtype : dtype_like
    ///     Any argument of ``numpy.dtype``, including a structured type:
    ///     ``message.array(IMU)["accel"]``.
    /// shape : int or tuple of int, optional
    ///     The shape, which the bytes must fit exactly. One dimension by default.
    /// offset : int
    ///     The number of bytes to skip at the start.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If the bytes do not fit the type and shape.
    #[pyo3(
        signature = (dtype=None, shape=None, *, offset=0),
        text_signature = "($self, dtype='uint8', shape=None, *, offset=0)"
    )]
    fn array<'py>(
        slf: &Bound<'py, Self>,
        dtype: Option<Bound<'py, PyAny>>,
        shape: Option<Bound<'py, PyAny>>,
        offset: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        array(slf.as_any(), dtype, shape, offset)
    }

    fn __len__(&self) -> usize {
        self.bytes.len()
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __repr__(&self) -> String {
        let Meta {
            sequence,
            timestamp_ns,
            len,
            lost,
        } = self.meta;
        format!(
            "<Message sequence={sequence} of {len} bytes, timestamp_ns={timestamp_ns}, \
             lost={lost}>"
        )
    }

    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let message = &slf.get().bytes;
        // SAFETY: Python calls this function; a message's bytes neither change nor move.
        unsafe { bytes::export(slf.as_any(), message.as_ptr(), message.len(), view, flags) }
    }
}

/// Returns a numpy array over a buffer.
pub(crate) fn array<'py>(
    buffer: &Bound<'py, PyAny>,
    dtype: Option<Bound<'py, PyAny>>,
    shape: Option<Bound<'py, PyAny>>,
    offset: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let view = buffer
        .py()
        .import("conduit_ring._arrays")?
        .getattr("view")?;
    view.call1((buffer, dtype, shape, offset))
}
