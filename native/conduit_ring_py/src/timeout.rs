//! Timeouts of waiting calls.

use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The longest time between two checks for Python's signals, such as Ctrl-C.
const SLICE: Duration = Duration::from_millis(100);

/// The time at which a wait ends; `None` waits without a timeout.
#[derive(Clone, Copy)]
pub(crate) struct Deadline(Option<Instant>);

impl Deadline {
    /// Converts a timeout in seconds.
    pub(crate) fn after(timeout: Option<f64>) -> PyResult<Deadline> {
        let Some(seconds) = timeout else {
            return Ok(Deadline(None));
        };
        if seconds.is_nan() || seconds < 0.0 {
            return Err(PyValueError::new_err(format!(
                "invalid timeout: expected seconds from 0, or None to wait without a timeout, \
                 got: {seconds}"
            )));
        }
        // A time that does not fit an Instant counts as no timeout.
        let duration = Duration::try_from_secs_f64(seconds).ok();
        Ok(Deadline(
            duration.and_then(|duration| Instant::now().checked_add(duration)),
        ))
    }

    /// Returns how long to wait next; zero after the timeout.
    pub(crate) fn slice(self) -> Duration {
        self.0.map_or(SLICE, |at| {
            at.saturating_duration_since(Instant::now()).min(SLICE)
        })
    }
}
