//! A topic that is not there, and what may have been meant.

use conduit_ring::{Error, Info, Listing, Topic};
use program::Failure;
use program::nearest::hint;

/// How many names are told at most.
const NAMES: usize = 20;

/// Refuses a topic that is not there. One that is broken is there.
pub fn refuse(topic: &Topic) -> Result<(), Failure> {
    match Info::read(topic) {
        Err(Error::NoTopic { .. }) => Err(failure(topic)),
        _ => Ok(()),
    }
}

/// What is said of a topic that is not there.
pub fn failure(topic: &Topic) -> Failure {
    let listing = Listing::read().unwrap_or_default();
    let names: Vec<&str> = listing.topics.iter().map(Topic::name).collect();
    Failure::Runtime(sentence(topic.name(), &names))
}

fn sentence(given: &str, names: &[&str]) -> String {
    let hint = hint(given, names.iter().copied());
    format!("no topic {given}{hint} {}", told(names))
}

fn told(names: &[&str]) -> String {
    match names {
        [] => "there are no topics".into(),
        names if names.len() <= NAMES => format!("topics: {}", names.join(" ")),
        names => format!(
            "topics: {} and {} more, which ganglion topics lists",
            names[..NAMES].join(" "),
            names.len() - NAMES
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_is_told_with_what_was_meant_and_what_there_is() {
        assert_eq!(
            sentence("camara", &["camera", "imu"]),
            "no topic camara; did you mean camera? topics: camera imu"
        );
        assert_eq!(sentence("lidar", &["imu"]), "no topic lidar; topics: imu");
        assert_eq!(sentence("imu", &[]), "no topic imu; there are no topics");
    }

    #[test]
    fn of_many_topics_the_first_are_told_and_how_many_there_are() {
        let names: Vec<String> = (10..35).map(|n| format!("front-{n}")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let text = sentence("front-99", &names);
        assert!(
            text.contains("front-29 and 5 more, which ganglion topics lists"),
            "{text}"
        );
        assert!(!text.contains("front-30"), "{text}");
    }
}
