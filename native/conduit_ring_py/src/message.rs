//! One message, the reader's own copy.

use std::ffi::c_int;

use conduit_ring::Meta;
use pyo3::ffi;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyMemoryView};

use crate::bytes;

/// One message: your own copy, which stays what it is as long as you keep it.
///
/// It is a read-only buffer, so ``bytes(message)``, ``memoryview(message)``, ``numpy.frombuffer(message)``,
/// ``struct.unpack_from(format, message)`` and ``file.write(message)`` all work on it; only ``bytes()`` copies.
#[pyclass(frozen, module = "conduit_ring")]
pub(crate) struct Message {
    pub(crate) bytes: Vec<u8>,
    pub(crate) meta: Meta,
}

#[pymethods]
impl Message {
    /// Its number. The messages of a topic count from 0; a publisher that takes over a dead one's topic goes on counting.
    #[getter]
    fn sequence(&self) -> u64 {
        self.meta.sequence
    }

    /// When it was published, in nanoseconds of :func:`now_ns`'s clock.
    #[getter]
    fn timestamp_ns(&self) -> u64 {
        self.meta.timestamp_ns
    }

    /// How many messages were lost between the one delivered before it and this one, because this subscriber was slower
    /// than the publisher by more than the ring holds (or, with ``policy="latest"``, was skipped on purpose).
    #[getter]
    fn lost(&self) -> u64 {
        self.meta.lost
    }

    /// Its bytes as a read-only ``memoryview``, not copied.
    #[getter]
    fn data(slf: &Bound<'_, Self>) -> PyResult<Py<PyMemoryView>> {
        PyMemoryView::from(slf.as_any()).map(Bound::unbind)
    }

    /// A copy of its bytes.
    fn tobytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.bytes)
    }

    /// Its bytes as a read-only numpy array, not copied. Needs numpy.
    ///
    /// ``dtype`` is whatever ``numpy.dtype`` takes, a structured type included: ``message.array(IMU)["accel"]``. Without a
    /// ``shape`` the array has one dimension; with one it must fit exactly. ``offset`` skips bytes at the start.
    ///
    /// Raises ``ValueError`` if the bytes do not fit type and shape.
    #[pyo3(signature = (dtype=None, shape=None, *, offset=0), text_signature = "($self, dtype='uint8', shape=None, *, offset=0)")]
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
            "<Message sequence={sequence} of {len} bytes, timestamp_ns={timestamp_ns}, lost={lost}>"
        )
    }

    unsafe fn __getbuffer__(
        slf: Bound<'_, Self>,
        view: *mut ffi::Py_buffer,
        flags: c_int,
    ) -> PyResult<()> {
        let message = &slf.get().bytes;
        // SAFETY: Python calls it; a message's bytes never change or move.
        unsafe { bytes::show(slf.as_any(), message.as_ptr(), message.len(), view, flags) }
    }
}

/// A numpy array over a buffer.
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
