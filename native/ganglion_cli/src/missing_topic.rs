//! The error for a topic that does not exist, with a suggestion.

use conduit_ring::{Error, Info, Listing, Topic};
use program::Failure;
use program::nearest::hint;

/// The most names that the error lists.
const MOST_NAMES: usize = 20;

/// Checks that a topic exists. A broken topic exists.
///
/// # Errors
/// [`failure`] when it does not.
pub fn check_exists(topic: &Topic) -> Result<(), Failure> {
    match Info::read(topic) {
        Err(Error::NoTopic { .. }) => Err(failure(topic)),
        _ => Ok(()),
    }
}

/// Returns the failure for a topic that does not exist.
pub fn failure(topic: &Topic) -> Failure {
    let listing = Listing::read().unwrap_or_default();
    let names: Vec<&str> = listing.topics.iter().map(Topic::name).collect();
    Failure::Runtime(message(topic.name(), &names))
}

fn message(given: &str, names: &[&str]) -> String {
    let hint = hint(given, names.iter().copied());
    format!("topic {given} not found{hint} {}", list(names))
}

fn list(names: &[&str]) -> String {
    match names {
        [] => "no topic exists".into(),
        names if names.len() <= MOST_NAMES => format!("topics: {}", names.join(" ")),
        names => format!(
            "topics: {} and {} more; see ganglion topics",
            names[..MOST_NAMES].join(" "),
            names.len() - MOST_NAMES
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_for_a_mistyped_name_suggests_the_closest_one_and_lists_all() {
        assert_eq!(
            message("camara", &["camera", "imu"]),
            "topic camara not found; did you mean camera? topics: camera imu"
        );
        assert_eq!(
            message("lidar", &["imu"]),
            "topic lidar not found; topics: imu"
        );
        assert_eq!(message("imu", &[]), "topic imu not found; no topic exists");
    }

    #[test]
    fn of_many_topics_the_first_are_listed_and_the_others_counted() {
        let names: Vec<String> = (10..35).map(|n| format!("front-{n}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let text = message("front-99", &names);
        assert!(
            text.contains("front-29 and 5 more; see ganglion topics"),
            "{text}"
        );
        assert!(!text.contains("front-30"), "{text}");
    }
}
