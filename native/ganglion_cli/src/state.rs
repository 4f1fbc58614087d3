//! A topic's state in a word.

use conduit_ring::State;

/// The word, the same in text and in JSON.
pub fn name(state: State) -> &'static str {
    match state {
        State::Live => "live",
        State::Dead => "dead",
        State::Closed => "closed",
        State::Retired => "retired",
        State::Legacy => "legacy",
        _ => "unknown",
    }
}
