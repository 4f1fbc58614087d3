//! Errors for C: a negative errno, and a message that is kept for the thread.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char, c_int};
use std::panic::{AssertUnwindSafe, catch_unwind};

use conduit_ring::{Error, PublishError};

use crate::errno;

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// The failure of a call.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Failure {
    errno: c_int,
    /// `None` for frequent outcomes whose errno says everything: no event, timeout, woken.
    message: Option<String>,
}

impl Failure {
    pub(crate) const NOTHING: Failure = Failure::plain(errno::EAGAIN);
    pub(crate) const TIMED_OUT: Failure = Failure::plain(errno::ETIMEDOUT);
    pub(crate) const WOKEN: Failure = Failure::plain(errno::ECANCELED);

    const fn plain(errno: c_int) -> Failure {
        Failure {
            errno,
            message: None,
        }
    }

    pub(crate) fn new(errno: c_int, message: impl Into<String>) -> Failure {
        Failure {
            errno,
            message: Some(message.into()),
        }
    }

    /// A mistake of the caller.
    pub(crate) fn invalid(message: impl Into<String>) -> Failure {
        Failure::new(errno::EINVAL, message)
    }

    /// A handle in an unknown state, because an earlier call panicked.
    pub(crate) fn broken(handle: &str) -> Failure {
        Failure::new(
            errno::ENOTRECOVERABLE,
            format!("{handle} failed inside an earlier call; close it"),
        )
    }

    fn panicked(payload: &(dyn Any + Send)) -> Failure {
        let text = payload
            .downcast_ref::<&str>()
            .copied()
            .or_else(|| payload.downcast_ref::<String>().map(String::as_str))
            .unwrap_or("no reason given");
        Failure::new(
            errno::ENOTRECOVERABLE,
            format!("fault inside conduit_ring: {text}"),
        )
    }

    /// Keeps the message for the thread and returns the negative errno.
    fn store(self) -> c_int {
        if let Some(message) = self.message {
            let text = CString::new(message.replace('\0', "\u{FFFD}")).unwrap_or_default();
            // Fails in a thread that is ending, which cannot read the message any more.
            let _ = LAST_ERROR.try_with(|last| last.replace(text));
        }
        -self.errno
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        let errno = match &error {
            Error::InvalidTopic { .. } | Error::InvalidGeometry { .. } => errno::EINVAL,
            Error::PublisherAlive { .. } => errno::EBUSY,
            Error::LegacyInUse { .. } => errno::EEXIST,
            Error::NoReaderSlot { .. } => errno::EUSERS,
            Error::TooManyLeases { .. } => errno::EMFILE,
            Error::NoTopic { .. } => errno::ENOENT,
            Error::Forked { .. } => errno::EPERM,
            Error::BadSegment { .. } => errno::EPROTO,
            other => other.errno().unwrap_or(errno::EIO),
        };
        Failure::new(errno, error.to_string())
    }
}

impl From<PublishError> for Failure {
    fn from(error: PublishError) -> Failure {
        let errno = match &error {
            PublishError::TooLarge { .. } => errno::EMSGSIZE,
            PublishError::SlotHeld => errno::EBUSY,
            PublishError::Forked => errno::EPERM,
            PublishError::NameLost => errno::ESTALE,
            _ => errno::EIO,
        };
        Failure::new(errno, error.to_string())
    }
}

/// Runs the body of a function that C calls, and turns its result into a status. Catches panics.
#[inline]
pub(crate) fn status(body: impl FnOnce() -> Result<(), Failure>) -> c_int {
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => 0,
        Ok(Err(failure)) => failure.store(),
        Err(payload) => Failure::panicked(&*payload).store(),
    }
}

/// Runs the body of a function that cannot fail. Returns `otherwise` after a panic.
pub(crate) fn infallible<T>(otherwise: T, body: impl FnOnce() -> T) -> T {
    catch_unwind(AssertUnwindSafe(body)).unwrap_or(otherwise)
}

#[unsafe(no_mangle)]
extern "C" fn conduit_ring_last_error() -> *const c_char {
    LAST_ERROR
        .try_with(|last| last.borrow().as_ptr())
        .unwrap_or(c"".as_ptr())
}

#[cfg(test)]
mod tests {
    use std::ffi::CStr;

    use super::*;

    fn last() -> String {
        // SAFETY: the message of this thread, which nothing replaces meanwhile.
        let text = unsafe { CStr::from_ptr(conduit_ring_last_error()) };
        text.to_str().unwrap().to_owned()
    }

    #[test]
    fn a_panic_becomes_an_error_with_its_text() {
        assert_eq!(status(|| panic!("at the disco")), -errno::ENOTRECOVERABLE);
        assert_eq!(last(), "fault inside conduit_ring: at the disco");
        assert_eq!(infallible(7, || panic!("again")), 7);
    }

    #[test]
    fn the_message_stays_until_the_next_failure_of_the_same_thread() {
        assert_eq!(status(|| Err(Failure::invalid("a\0b"))), -errno::EINVAL);
        assert_eq!(last(), "a\u{FFFD}b");
        assert_eq!(status(|| Ok(())), 0);
        assert_eq!(status(|| Err(Failure::NOTHING)), -errno::EAGAIN);
        assert_eq!(last(), "a\u{FFFD}b");
        assert_eq!(std::thread::spawn(last).join().unwrap(), "");
    }
}
