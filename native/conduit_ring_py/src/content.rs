//! The encoding of a topic's messages.

use conduit_ring::ContentTag;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyString;

/// Return the tag of an encoding's name in a topic: its 64-bit FNV-1a hash.
///
/// >>> hex(content_tag("sensor_msgs/msg/Imu"))
/// '0xffd04c1d689648a2'
#[pyfunction]
#[pyo3(signature = (name, /))]
pub(crate) fn content_tag(name: &str) -> u64 {
    ContentTag::of(name).value()
}

/// Converts a name, a tag or `None`.
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
                "invalid content: expected an encoding's name, its 64-bit tag or None, got: {}",
                content
                    .repr()
                    .map_or_else(|_| "another object".into(), |text| text.to_string())
            ))
        })
}
