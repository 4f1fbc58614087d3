//! The messages that a subscription may still send, and to whom: `active` as in `:inet`, and
//! single requests. Pure.

use std::collections::VecDeque;

/// The mode that a caller sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Active {
    /// All messages, without end.
    Always,
    /// The next message.
    Once,
    /// This many more; a negative number takes credits back.
    More(i64),
    /// No message.
    Never,
}

/// The thread's next step.
#[derive(Debug, PartialEq, Eq)]
pub enum Next<C> {
    /// Answer this request.
    Answer(Request<C>),
    /// Send the owner a message.
    Deliver,
    /// Wait for demand.
    Park,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Always,
    Once,
    Credits(i64),
}

/// A request for one message.
#[derive(Debug, PartialEq, Eq)]
pub struct Request<C> {
    /// The request's number, unique within the subscription.
    pub id: u64,
    /// The caller and the kind of message that it wants.
    pub caller: C,
}

/// The requested messages that are not sent yet.
#[derive(Debug)]
pub struct Demand<C> {
    mode: Mode,
    requests: VecDeque<Request<C>>,
    /// The request that the thread is answering.
    in_progress: Option<InProgress>,
}

#[derive(Clone, Copy, Debug)]
struct InProgress {
    id: u64,
    cancelled: bool,
}

impl<C> Default for Demand<C> {
    fn default() -> Self {
        Self {
            mode: Mode::Credits(0),
            requests: VecDeque::new(),
            in_progress: None,
        }
    }
}

impl<C> Demand<C> {
    /// Sets the mode. Credits add up. Returns `true` when no credit is left, so that the owner
    /// must be notified that it is passive.
    pub fn set(&mut self, active: Active) -> bool {
        self.mode = match (active, self.mode) {
            (Active::Always, _) => Mode::Always,
            (Active::Once, _) => Mode::Once,
            (Active::Never, _) => Mode::Credits(0),
            (Active::More(more), Mode::Credits(left)) => {
                Mode::Credits(left.saturating_add(more).max(0))
            }
            (Active::More(more), _) => Mode::Credits(more.max(0)),
        };
        matches!(active, Active::More(_)) && self.mode == Mode::Credits(0)
    }

    /// Returns whether messages are delivered to the owner.
    pub fn is_active(&self) -> bool {
        self.mode != Mode::Credits(0)
    }

    /// Adds a request for one message.
    pub fn request(&mut self, request: Request<C>) {
        self.requests.push_back(request);
    }

    /// Cancels a request. Returns `false` when the thread is answering it or has answered it;
    /// then an answer arrives or has arrived.
    pub fn cancel(&mut self, id: u64) -> bool {
        let in_progress = self.in_progress.as_mut();
        if let Some(request) = in_progress.filter(|request| request.id == id) {
            request.cancelled = true;
        }
        let before = self.requests.len();
        self.requests.retain(|request| request.id != id);
        self.requests.len() < before
    }

    /// Returns the next step. Requests come first.
    pub fn next(&mut self) -> Next<C> {
        let request = self.requests.pop_front();
        self.in_progress = request.as_ref().map(|request| InProgress {
            id: request.id,
            cancelled: false,
        });
        match request {
            Some(request) => Next::Answer(request),
            None if self.is_active() => Next::Deliver,
            None => Next::Park,
        }
    }

    /// Puts back the request in progress, for which there is no message yet. Returns it when it
    /// was cancelled meanwhile.
    pub fn postpone(&mut self, request: Request<C>) -> Option<Request<C>> {
        let in_progress = self.in_progress.take();
        if in_progress.is_some_and(|request| request.cancelled) {
            return Some(request);
        }
        self.requests.push_front(request);
        None
    }

    /// Removes all requests.
    pub fn drain(&mut self) -> impl Iterator<Item = Request<C>> {
        self.requests.drain(..)
    }

    /// Counts a message to the owner. Returns `true` when it takes the last credit.
    pub fn count_delivery(&mut self) -> bool {
        match &mut self.mode {
            Mode::Always => false,
            Mode::Once => {
                self.mode = Mode::Credits(0);
                false
            }
            Mode::Credits(0) => false,
            Mode::Credits(left) => {
                *left -= 1;
                *left == 0
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn credits_add_up_and_run_out() {
        let mut demand = Demand::<()>::default();
        assert!(!demand.set(Active::More(2)));
        assert!(!demand.set(Active::More(1)));
        assert_eq!(
            [
                demand.count_delivery(),
                demand.count_delivery(),
                demand.count_delivery()
            ],
            [false, false, true]
        );
        assert_eq!(demand.next(), Next::Park);
    }

    #[test]
    fn taking_all_credits_back_makes_passive() {
        let mut demand = Demand::<()>::default();
        demand.set(Active::More(2));
        assert!(demand.set(Active::More(-5)));
        assert_eq!(demand.next(), Next::Park);
    }

    #[test]
    fn once_is_one_message_without_a_notification_at_its_end() {
        let mut demand = Demand::<()>::default();
        demand.set(Active::Once);
        assert_eq!(demand.next(), Next::Deliver);
        assert!(!demand.count_delivery());
        assert_eq!(demand.next(), Next::Park);
    }

    #[test]
    fn always_lasts_until_the_mode_changes() {
        let mut demand = Demand::<()>::default();
        demand.set(Active::Always);
        assert!(!(0..1000).any(|_| demand.count_delivery()));
        assert!(!demand.set(Active::Never));
        assert_eq!(demand.next(), Next::Park);
    }

    fn request(id: u64) -> Request<()> {
        Request { id, caller: () }
    }

    #[test]
    fn requests_come_first_and_in_order() {
        let mut demand = Demand::default();
        demand.set(Active::Always);
        demand.request(request(1));
        demand.request(request(2));
        assert!(demand.cancel(1));
        assert!(!demand.cancel(1));
        assert_eq!(demand.next(), Next::Answer(request(2)));
        assert_eq!(demand.next(), Next::Deliver);
    }

    #[test]
    fn a_request_cancelled_in_progress_is_returned_instead_of_postponed() {
        let mut demand = Demand::default();
        demand.request(request(1));
        assert_eq!(demand.next(), Next::Answer(request(1)));
        assert!(!demand.cancel(1));
        assert_eq!(demand.postpone(request(1)), Some(request(1)));
    }

    #[test]
    fn cancelling_an_answered_request_does_not_affect_the_next_one() {
        let mut demand = Demand::default();
        demand.request(request(1));
        demand.request(request(2));
        demand.next();
        assert_eq!(demand.next(), Next::Answer(request(2)));
        assert!(!demand.cancel(1));
        assert_eq!(demand.postpone(request(2)), None);
        assert_eq!(demand.next(), Next::Answer(request(2)));
    }
}
