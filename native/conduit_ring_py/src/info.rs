//! The state of topics, read from outside.

use conduit_ring::{Info, Listing, Reader, State, Topic};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::errors;

/// Return the names of all topics, sorted, including those of dead publishers.
#[pyfunction]
pub(crate) fn topics() -> PyResult<Vec<String>> {
    let listing = Listing::read().map_err(errors::of_ring)?;
    let names = listing.topics.iter().map(|topic| topic.name().to_owned());
    Ok(names.collect())
}

/// Return the state of a topic, read from outside: without writing and without a reader slot.
///
/// Returns
/// -------
/// TopicInfo
///     The state at one time.
///
/// Raises
/// ------
/// NoTopicError
///     If the topic does not exist.
#[pyfunction]
#[pyo3(signature = (topic, /))]
pub(crate) fn info<'py>(py: Python<'py>, topic: &str) -> PyResult<Bound<'py, PyAny>> {
    let topic = Topic::found(topic).map_err(errors::of_ring)?;
    let info = py.detach(|| Info::read(&topic)).map_err(errors::of_ring)?;
    to_python(py, &info)
}

/// Converts the state to a `TopicInfo`.
pub(crate) fn to_python<'py>(py: Python<'py>, info: &Info) -> PyResult<Bound<'py, PyAny>> {
    let types = py.import("conduit_ring._types")?;
    let reader_info = types.getattr("ReaderInfo")?;
    let readers = info
        .readers
        .iter()
        .map(|reader| reader_info.call((), Some(&of_reader(py, reader)?)))
        .collect::<PyResult<Vec<_>>>()?;

    let fields = PyDict::new(py);
    fields.set_item("topic", info.topic.name())?;
    fields.set_item("slot_count", info.geometry.slot_count())?;
    fields.set_item("slot_size", info.geometry.slot_size())?;
    fields.set_item("max_message_size", info.geometry.max_message_size())?;
    fields.set_item("state", name(info.state))?;
    fields.set_item("published", info.published)?;
    fields.set_item("content", info.content.value())?;
    fields.set_item("epoch", info.epoch)?;
    fields.set_item("instance_id", info.instance_id)?;
    fields.set_item("writer_pid", info.writer_pid)?;
    fields.set_item("last_publish_ns", info.last_publish_ns)?;
    fields.set_item("realtime_offset_ns", info.realtime_offset_ns)?;
    fields.set_item("dropped_pinned", info.dropped_pinned)?;
    fields.set_item("rejected_oversize", info.rejected_oversize)?;
    fields.set_item("wake_count", info.wake_count)?;
    fields.set_item("readers", PyTuple::new(py, readers)?)?;
    types.getattr("TopicInfo")?.call((), Some(&fields))
}

fn of_reader<'py>(py: Python<'py>, reader: &Reader) -> PyResult<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    fields.set_item("index", reader.index)?;
    fields.set_item("native", reader.native)?;
    fields.set_item("alive", reader.alive)?;
    fields.set_item("waiting", reader.waiting)?;
    fields.set_item("pid", reader.pid)?;
    fields.set_item("next_sequence", reader.next_sequence)?;
    fields.set_item("lost", reader.lost)?;
    Ok(fields)
}

fn name(state: State) -> &'static str {
    match state {
        State::Live => "live",
        State::Dead => "dead",
        State::Closed => "closed",
        State::Retired => "retired",
        State::Legacy => "legacy",
        _ => "unknown",
    }
}
