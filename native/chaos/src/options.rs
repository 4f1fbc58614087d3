//! The arguments of the program.

use std::path::PathBuf;
use std::time::Duration;

use conduit_ring::Topic;
use program::Failure;
use program::arguments::{Arguments, required};

use crate::fault::Fault;
use crate::plan::{Behaviour, TOPICS};
use crate::random::Random;
use crate::ring::Settings;

/// The text for `--help`.
pub const HELP: &str = "\
Usage: chaos ring [--kills N] [--seed N] [--patience N] [--inject FAULT] [--json]
                  [-- NODE-COMMAND...]

Kills publishers, readers and BEAM nodes at random times, starts them again and checks the
messages that the readers accept. Exits with 1 if it finds a fault.

  --kills N       number of processes to kill (default 1000)
  --seed N        seed of the random choices (default: a random seed, which is printed)
  --patience N    seconds within which a topic must deliver messages again (default 30)
  --inject FAULT  inject a fault to show that it is found: torn, reused, stuck or leaked
  --json          print a last line with the keys \"kills\", \"messages\", \"torn\", \"stuck\",
                  \"leaked\" and \"reused\"
  NODE-COMMAND    command that starts a BEAM node, which the CHAOS_* environment variables
                  configure (default: no nodes)
";

/// A request to the program.
pub enum Request {
    /// Print the help.
    Help,
    /// Run the test.
    Ring {
        /// The settings of the run.
        settings: Settings,
        /// Whether to print the result as JSON too.
        json: bool,
    },
    /// Run as a publisher.
    Publish {
        /// The topic's number in the plan.
        number: usize,
        /// The topic.
        topic: Topic,
        /// Whether to corrupt some messages.
        corrupt: bool,
    },
    /// Run as a reader.
    Subscribe {
        /// The topic's number in the plan.
        number: usize,
        /// The topic.
        topic: Topic,
        /// The behaviour of the reader.
        behaviour: Behaviour,
        /// The log for the accepted messages.
        log: PathBuf,
    },
}

const VERBS: &str = "ring";

/// Parses the arguments, which do not include the program's name.
pub fn parse(arguments: impl IntoIterator<Item = String>) -> Result<Request, Failure> {
    let mut arguments = arguments.into_iter();
    let verb = arguments
        .next()
        .ok_or_else(|| Failure::Usage(format!("VERB is missing; expected one of: {VERBS}")))?;
    let rest: Vec<String> = arguments.collect();
    match verb.as_str() {
        "--help" => Ok(Request::Help),
        "ring" => ring(rest),
        "publish" | "subscribe" => peer(&verb, rest),
        _ => Err(Failure::Usage(format!(
            "unknown verb {verb:?}; expected one of: {VERBS}"
        ))),
    }
}

fn ring(rest: Vec<String>) -> Result<Request, Failure> {
    let end = rest.iter().position(|argument| argument == "--");
    let (options, node_command) = match end {
        Some(end) => (&rest[..end], &rest[end + 1..]),
        None => (&rest[..], &[][..]),
    };
    let known = &[
        "--kills",
        "--seed",
        "--json",
        "--patience",
        "--inject",
        "--help",
    ];
    let mut arguments = Arguments::new(options.iter().cloned(), known);
    let mut settings = Settings {
        kills: 1000,
        seed: Random::seed(),
        node_command: node_command.to_vec(),
        patience: Duration::from_secs(30),
        inject: None,
    };
    let mut json = false;
    while let Some(option) = arguments.next()? {
        match option {
            "--kills" => {
                settings.kills = arguments.parse("a number from 1", |&kills| kills > 0)?
            }
            "--seed" => settings.seed = arguments.parse("a number from 0", |_| true)?,
            "--patience" => {
                let seconds = arguments.parse("a number of seconds from 1", |&n| n > 0)?;
                settings.patience = Duration::from_secs(seconds);
            }
            "--inject" => {
                settings.inject =
                    Some(arguments.read("torn, reused, stuck, leaked", Fault::parse)?);
            }
            "--json" => json = true,
            _ => return Ok(Request::Help),
        }
    }
    Ok(Request::Ring { settings, json })
}

fn peer(verb: &str, rest: Vec<String>) -> Result<Request, Failure> {
    let known = &[
        "--number",
        "--topic",
        "--log",
        "--restless",
        "--leasing",
        "--corrupt",
    ];
    let mut arguments = Arguments::new(rest, known);
    let (mut number, mut topic, mut log) = (None, None, None);
    let (mut behaviour, mut corrupt) = (Behaviour::Steady, false);
    while let Some(option) = arguments.next()? {
        match option {
            "--number" => {
                number = Some(arguments.parse("a topic's number", |&n| n < TOPICS.len())?);
            }
            "--topic" => {
                topic = Some(arguments.read("a topic's name", |text| Topic::new(text).ok())?);
            }
            "--log" => log = Some(arguments.path("a file")?),
            "--restless" => behaviour = Behaviour::Restless,
            "--leasing" => behaviour = Behaviour::Leasing,
            _ => corrupt = true,
        }
    }
    let number = required(number, "--number", "a topic's number")?;
    let topic = required(topic, "--topic", "a topic's name")?;
    if verb == "publish" {
        return Ok(Request::Publish {
            number,
            topic,
            corrupt,
        });
    }
    Ok(Request::Subscribe {
        number,
        topic,
        behaviour,
        log: required(log, "--log", "a file")?,
    })
}
