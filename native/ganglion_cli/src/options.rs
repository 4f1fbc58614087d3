//! The options of the verbs and how each is parsed.

use conduit_ring::Topic;
use program::Failure;
use program::arguments::Arguments;
use std::time::Duration;

/// A description of a topic's name for error messages.
pub const TOPIC: &str = "a ring topic, 1 to 200 characters of A-Z a-z 0-9 _ . -";
const SECONDS: &str = "0.01 to 3600 seconds";

/// The options of all verbs. A verb's `options` list says which of them it accepts.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The verb's topic; present if the verb takes one.
    topic: Option<Topic>,
    /// Print JSON instead of text.
    pub json: bool,
    /// Only topics whose names start with this prefix.
    pub prefix: String,
    /// Number of messages or lines after which to end.
    pub count: Option<u64>,
    /// Print bytes without decoding them.
    pub raw: bool,
    /// Wait for a topic that does not exist.
    pub wait: bool,
    /// Start with the newest message that the ring holds.
    pub latest: bool,
    /// Time between two lines.
    pub every: Duration,
    /// Time span that a line summarises.
    pub window: Duration,
    /// Time over which `topics` measures rates.
    pub look: Duration,
    /// Repair.
    pub fix: bool,
    /// Leave the files of dead publishers to their successors.
    pub keep_dead: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            topic: None,
            json: false,
            prefix: String::new(),
            count: None,
            raw: false,
            wait: false,
            latest: false,
            every: Duration::from_secs(1),
            window: Duration::from_secs(5),
            look: Duration::from_secs(1),
            fix: false,
            keep_dead: false,
        }
    }
}

impl Options {
    /// Returns the verb's topic.
    ///
    /// # Panics
    /// In a verb that takes no topic.
    pub fn topic(&self) -> &Topic {
        self.topic.as_ref().expect("the verb takes a topic")
    }

    /// Returns whether a topic was given.
    pub fn has_topic(&self) -> bool {
        self.topic.is_some()
    }

    /// Sets the topic.
    ///
    /// # Errors
    /// [`Failure::Usage`] when `name` is not a topic's name.
    pub fn set_topic(&mut self, name: &str) -> Result<(), Failure> {
        let topic = Topic::found(name).map_err(|_| {
            Failure::Usage(format!("invalid TOPIC: expected {TOPIC}, got: {name:?}"))
        })?;
        self.topic = Some(topic);
        Ok(())
    }

    /// Sets `option` to the value that follows in `arguments`.
    ///
    /// # Errors
    /// [`Failure::Usage`] when the value is missing or invalid.
    ///
    /// # Panics
    /// When a verb lists an option that this function does not know.
    pub fn set(&mut self, option: &str, arguments: &mut Arguments) -> Result<(), Failure> {
        match option {
            "--json" => self.json = true,
            "--raw" => self.raw = true,
            "--wait" => self.wait = true,
            "--latest" => self.latest = true,
            "--fix" => self.fix = true,
            "--keep-dead" => self.keep_dead = true,
            "--prefix" => {
                self.prefix = arguments
                    .parse("the start of a topic's name", |name: &String| {
                        !name.is_empty()
                    })?;
            }
            "--count" => {
                self.count = Some(arguments.parse("a number from 1", |&count| count > 0)?);
            }
            "--every" => self.every = seconds(arguments)?,
            "--window" => self.window = seconds(arguments)?,
            "--look" => self.look = seconds(arguments)?,
            _ => unreachable!("option {option} of a verb is not parsed"),
        }
        Ok(())
    }
}

fn seconds(arguments: &mut Arguments) -> Result<Duration, Failure> {
    let seconds: f64 = arguments.parse(SECONDS, |s| (0.01..=3600.0).contains(s))?;
    Ok(Duration::from_secs_f64(seconds))
}
