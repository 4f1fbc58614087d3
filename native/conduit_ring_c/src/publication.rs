//! The state behind a publisher's handle, shared with the thread that checks the topic's name.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use conduit_ring::{Owner, PublishError, Publisher, SuspendedLoan, upkeep::Upkeep};

use crate::errno;
use crate::failure::Failure;

/// The opaque handle of a publisher.
pub(crate) struct conduit_ring_publisher {
    /// The thread that checks the topic's name, if there is one. Dropped first, so that it ends
    /// first.
    _upkeep: Option<Upkeep>,
    shared: Arc<Shared>,
}

/// The state that the handle shares with its thread. The lock lets several threads publish.
pub(crate) struct Shared {
    inner: Mutex<Inner>,
    owner: Owner,
}

pub(crate) struct Inner {
    /// `None` after the topic was ended.
    publisher: Option<Publisher>,
    /// The outstanding loan. Its holder writes to the next message's slot, so nothing else is
    /// published.
    loan: Option<SuspendedLoan>,
    /// The next sequence number at the last check of the name.
    checked_at: Option<u64>,
}

impl conduit_ring_publisher {
    pub(crate) fn new(publisher: Publisher, own_thread: bool) -> conduit_ring_publisher {
        let shared = Arc::new(Shared {
            inner: Mutex::new(Inner {
                publisher: Some(publisher),
                loan: None,
                checked_at: None,
            }),
            owner: Owner::here(),
        });
        let watched = shared.clone();
        let upkeep = own_thread.then(|| Upkeep::start(move || watched.check_name()));
        conduit_ring_publisher {
            _upkeep: upkeep.and_then(Result::ok),
            shared,
        }
    }

    #[inline]
    pub(crate) fn lock(&self) -> Result<MutexGuard<'_, Inner>, Failure> {
        if !self.shared.owner.is_here() {
            return Err(PublishError::Forked.into());
        }
        let inner = self.shared.inner.lock();
        inner.map_err(|_| Failure::broken("publisher"))
    }

    /// Takes the publisher to end it. Returns `None` in a child of the process that opened it.
    pub(crate) fn take(&self) -> Option<Publisher> {
        if !self.shared.owner.is_here() {
            return None;
        }
        let inner = self.shared.inner.lock();
        inner
            .unwrap_or_else(PoisonError::into_inner)
            .publisher
            .take()
    }
}

impl Shared {
    /// Checks the topic's name. Returns `false` when the topic was ended.
    fn check_name(&self) -> bool {
        match self.inner.try_lock() {
            Ok(mut inner) => inner.check_name(),
            // Another thread is publishing, which checks the name too.
            Err(TryLockError::WouldBlock) => true,
            Err(TryLockError::Poisoned(_)) => false,
        }
    }
}

fn ended() -> Failure {
    Failure::new(errno::ESHUTDOWN, "publisher has ended its topic")
}

impl Inner {
    pub(crate) fn publisher(&mut self) -> Result<&mut Publisher, Failure> {
        self.publisher.as_mut().ok_or_else(ended)
    }

    fn check_name(&mut self) -> bool {
        let Some(publisher) = &mut self.publisher else {
            return false;
        };
        let next = Some(publisher.next_sequence());
        // A publisher that publishes checks its name itself. A loan is written to the current
        // file.
        if self.loan.is_none() && self.checked_at == next {
            // The next call that publishes returns the error, and the next check tries again.
            let _ = publisher.look_after();
        }
        self.checked_at = next;
        true
    }

    /// Converts a result, and adds the reason to the error for a lost name.
    pub(crate) fn explain<T>(&self, result: Result<T, PublishError>) -> Result<T, Failure> {
        let trouble = self.publisher.as_ref().and_then(Publisher::trouble);
        result.map_err(|error| match (error, trouble) {
            (PublishError::NameLost, Some(trouble)) => {
                Failure::new(errno::ESTALE, format!("{error}: {trouble}"))
            }
            _ => error.into(),
        })
    }

    #[inline]
    pub(crate) fn publish(&mut self, parts: &[&[u8]]) -> Result<u64, Failure> {
        let published = self.without_loan()?.publish_slices(parts);
        self.explain(published)
    }

    /// Returns the publisher if no loan is outstanding.
    #[inline]
    pub(crate) fn without_loan(&mut self) -> Result<&mut Publisher, Failure> {
        let publisher = self.publisher.as_mut().ok_or_else(ended)?;
        if self.loan.is_none() {
            Ok(publisher)
        } else {
            Err(Failure::new(
                errno::EALREADY,
                "publisher has an outstanding loan; commit or cancel it first",
            ))
        }
    }

    pub(crate) fn loan(&mut self, len: usize) -> Result<*mut u8, Failure> {
        let loan = self.without_loan()?.loan(len).map(|loan| loan.suspend());
        let loan = self.explain(loan)?;
        Ok(self.loan.insert(loan).as_mut_ptr())
    }

    pub(crate) fn cancel_loan(&mut self) {
        self.loan = None;
    }

    pub(crate) fn commit(&mut self, len: usize) -> Result<u64, Failure> {
        let publisher = self.publisher.as_mut().ok_or_else(ended)?;
        let size = self.loan.as_ref().map(SuspendedLoan::len);
        let size = size.ok_or_else(|| Failure::invalid("publisher has no loan to commit"))?;
        if len > size {
            return Err(Failure::invalid(format!(
                "expected to commit at most the loan's {size} bytes, got: {len}"
            )));
        }
        let loan = self.loan.take();
        let mut loan = loan
            .and_then(|loan| loan.resume(publisher))
            .ok_or_else(|| Failure::broken("publisher"))?;
        loan.truncate(len);
        Ok(loan.commit())
    }
}
