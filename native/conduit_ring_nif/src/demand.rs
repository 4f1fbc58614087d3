//! How many messages a subscription may still send, and to whom: `active` as in `:inet`, and single requests.

use std::collections::VecDeque;

/// The mode that a caller sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Active {
    /// Every message, without end.
    Always,
    /// The next one.
    Once,
    /// So many more; a negative number takes credits back.
    More(i64),
    /// None.
    Never,
}

/// What the thread does next.
#[derive(Debug, PartialEq, Eq)]
pub enum Next<W> {
    /// Answer this request.
    Answer(Request<W>),
    /// Send the owner a message.
    Deliver,
    /// Nobody asks for anything.
    Park,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    Always,
    Once,
    Credits(i64),
}

/// A request for one message, known by its number.
#[derive(Debug, PartialEq, Eq)]
pub struct Request<W> {
    /// Unique within the subscription.
    pub id: u64,
    /// What is wanted, and by whom.
    pub what: W,
}

/// What has been asked for and not been given yet.
#[derive(Debug)]
pub struct Demand<W> {
    mode: Mode,
    requests: VecDeque<Request<W>>,
    /// The request that the thread has in hand.
    in_hand: Option<InHand>,
}

#[derive(Clone, Copy, Debug)]
struct InHand {
    id: u64,
    cancelled: bool,
}

impl<W> Default for Demand<W> {
    fn default() -> Self {
        Self {
            mode: Mode::Credits(0),
            requests: VecDeque::new(),
            in_hand: None,
        }
    }
}

impl<W> Demand<W> {
    /// Sets the mode; credits add up. True when that used up what there was: the owner is to be told that it is passive.
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

    /// True while messages go to the owner.
    pub fn is_active(&self) -> bool {
        self.mode != Mode::Credits(0)
    }

    /// Asks for one message.
    pub fn request(&mut self, request: Request<W>) {
        self.requests.push_back(request);
    }

    /// Takes a request back. False when the thread has it in hand or has answered it: then an answer comes, or has come.
    pub fn cancel(&mut self, id: u64) -> bool {
        if let Some(in_hand) = self.in_hand.as_mut().filter(|in_hand| in_hand.id == id) {
            in_hand.cancelled = true;
        }
        let before = self.requests.len();
        self.requests.retain(|request| request.id != id);
        self.requests.len() < before
    }

    /// What is to be done next; requests come first.
    pub fn next(&mut self) -> Next<W> {
        let request = self.requests.pop_front();
        self.in_hand = request.as_ref().map(|request| InHand {
            id: request.id,
            cancelled: false,
        });
        match request {
            Some(request) => Next::Answer(request),
            None if self.is_active() => Next::Deliver,
            None => Next::Park,
        }
    }

    /// Puts back the request in hand, for which there is no message yet, or gives it back when it was cancelled meanwhile.
    pub fn postpone(&mut self, request: Request<W>) -> Option<Request<W>> {
        if self.in_hand.take().is_some_and(|in_hand| in_hand.cancelled) {
            return Some(request);
        }
        self.requests.push_front(request);
        None
    }

    /// Every request that is left, to be refused.
    pub fn drain(&mut self) -> impl Iterator<Item = Request<W>> {
        self.requests.drain(..)
    }

    /// Counts a message that the owner is given next. True when the last credit goes with it.
    pub fn delivered(&mut self) -> bool {
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
            [demand.delivered(), demand.delivered(), demand.delivered()],
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
    fn once_is_one_message_without_a_word_at_its_end() {
        let mut demand = Demand::<()>::default();
        demand.set(Active::Once);
        assert_eq!(demand.next(), Next::Deliver);
        assert!(!demand.delivered());
        assert_eq!(demand.next(), Next::Park);
    }

    #[test]
    fn always_never_ends_until_it_is_taken_back() {
        let mut demand = Demand::<()>::default();
        demand.set(Active::Always);
        assert!(!(0..1000).any(|_| demand.delivered()));
        assert!(!demand.set(Active::Never));
        assert_eq!(demand.next(), Next::Park);
    }

    fn request(id: u64) -> Request<()> {
        Request { id, what: () }
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
    fn a_request_cancelled_in_hand_is_given_back_instead_of_waiting_on() {
        let mut demand = Demand::default();
        demand.request(request(1));
        assert_eq!(demand.next(), Next::Answer(request(1)));
        assert!(!demand.cancel(1));
        assert_eq!(demand.postpone(request(1)), Some(request(1)));
    }

    #[test]
    fn cancelling_an_answered_request_leaves_the_next_one_alone() {
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
