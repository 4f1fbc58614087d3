//! The encoding of a topic's messages.

use conduit_ring::ContentTag;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyString;

/// The number that stands for an encoding's name in a topic: FNV-1a, 64 bits.
///
/// >>> hex(content_tag("sensor_msgs/msg/Imu"))
/// '0xffd04c1d689648a2'
#[pyfunction]
#[pyo3(signature = (name, /))]
pub(crate) fn content_tag(name: &str) -> u64 {
    ContentTag::of(name).value()
}

/// A name, a tag, or nothing.
pub(crate) fn of_argument(content: Option<&Bound<'_, PyAny>>) -> PyResult<ContentTag> {
    let Some(content) = content else {
        return Ok(ContentTag::RAW);
    };
    if let Ok(name) = content.cast::<PyString>() {
        return Ok(ContentTag::of(name.to_cow()?.as_ref()));
    }
    content
        .extract::<u64>()
        .map(ContentTag::from_value)
        .map_err(|_| {
            PyTypeError::new_err(format!(
                "content is {}; accepted are an encoding's name, its 64-bit tag, or None",
                content
                    .repr()
                    .map_or_else(|_| "something else".into(), |text| text.to_string())
            ))
        })
}
