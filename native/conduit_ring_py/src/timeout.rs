//! How long a caller wants to wait.

use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The longest time without a look at Python's signals, so that Ctrl-C is heard.
const SLICE: Duration = Duration::from_millis(100);

/// When a wait ends; `None` is never.
#[derive(Clone, Copy)]
pub(crate) struct Deadline(Option<Instant>);

impl Deadline {
    /// From seconds as Python gives them.
    pub(crate) fn after(timeout: Option<f64>) -> PyResult<Deadline> {
        let Some(seconds) = timeout else {
            return Ok(Deadline(None));
        };
        if seconds.is_nan() || seconds < 0.0 {
            return Err(PyValueError::new_err(format!(
                "timeout is {seconds}; accepted are seconds from 0, or None to wait for ever"
            )));
        }
        // What is too long for an Instant is for ever.
        let duration = Duration::try_from_secs_f64(seconds).ok();
        Ok(Deadline(
            duration.and_then(|duration| Instant::now().checked_add(duration)),
        ))
    }

    /// How long to sleep next; zero when the time is up.
    pub(crate) fn slice(self) -> Duration {
        self.0.map_or(SLICE, |at| {
            at.saturating_duration_since(Instant::now()).min(SLICE)
        })
    }
}
