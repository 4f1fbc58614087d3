//! Conversion of errors into the program's failure.

use program::Failure;

/// Converts an error at run time, such as one of the ring.
pub fn runtime(error: impl std::error::Error) -> Failure {
    Failure::Runtime(error.to_string())
}
