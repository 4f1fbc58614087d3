//! The ring's errors as Python exceptions.

use conduit_ring::{Error, PublishError};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::import_exception;
use pyo3::prelude::*;

import_exception!(conduit_ring._types, RingError);
import_exception!(conduit_ring._types, PublisherAliveError);
import_exception!(conduit_ring._types, NoReaderSlotError);
import_exception!(conduit_ring._types, NoTopicError);
import_exception!(conduit_ring._types, BadSegmentError);
import_exception!(conduit_ring._types, LeaseLimitError);
import_exception!(conduit_ring._types, ClosedError);
import_exception!(conduit_ring._types, MessageTooLargeError);
import_exception!(conduit_ring._types, NameLostError);
import_exception!(conduit_ring._types, SlotHeldError);

/// Converts an error: a mistake of the caller to a `ValueError`, an error of the operating system
/// to an `OSError`, any other to a `RingError`.
pub(crate) fn of_ring(error: Error) -> PyErr {
    let text = error.to_string();
    match error {
        Error::InvalidTopic { .. } | Error::InvalidGeometry { .. } => PyValueError::new_err(text),
        Error::PublisherAlive { pid, .. } => PublisherAliveError::new_err((text, pid)),
        Error::NoReaderSlot { .. } => NoReaderSlotError::new_err(text),
        Error::TooManyLeases { .. } => LeaseLimitError::new_err(text),
        Error::NoTopic { .. } => NoTopicError::new_err(text),
        Error::BadSegment { .. } | Error::LegacyInUse { .. } => BadSegmentError::new_err(text),
        Error::Os {
            action,
            path,
            source,
        } => match source.raw_os_error() {
            Some(errno) => {
                let reason = format!("{action}: {source}");
                PyOSError::new_err((errno, reason, path.display().to_string()))
            }
            None => PyOSError::new_err(text),
        },
        _ => RingError::new_err(text),
    }
}

/// Converts an error of publishing. `trouble` is the reason why the topic's name is lost.
pub(crate) fn of_publish(error: PublishError, trouble: Option<&Error>) -> PyErr {
    match error {
        PublishError::NameLost => NameLostError::new_err(match trouble {
            Some(trouble) => format!("{error}: {trouble}"),
            None => error.to_string(),
        }),
        PublishError::TooLarge { .. } => MessageTooLargeError::new_err(error.to_string()),
        PublishError::SlotHeld => SlotHeldError::new_err(error.to_string()),
        _ => RingError::new_err(error.to_string()),
    }
}

/// Returns the error for a closed object.
pub(crate) fn closed(kind: &str) -> PyErr {
    ClosedError::new_err(format!("{kind} is closed"))
}
