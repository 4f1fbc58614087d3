//! What the program is asked to do.

use std::path::PathBuf;
use std::time::Duration;

use conduit_ring::Topic;
use program::Failure;
use program::arguments::{Arguments, required};

use crate::plan::{LINES, Manner};
use crate::random::Random;
use crate::ring::{Inject, Settings};

/// The answer to `--help`.
pub const HELP: &str = "\
usage: chaos ring [--kills N] [--seed N] [--json] [--patience N] [--inject FAULT] [-- NODE-COMMAND…]

Kills publishers, readers and BEAM nodes at random instants while messages that prove themselves flow, starts them
again, and judges what was accepted. Exit status 1 when a promise of the ring was broken.

  --kills N       processes to kill (default 1000)
  --seed N        what the random choices follow from (default: one of the moment, which is printed)
  --json          the last line is {\"kills\", \"messages\", \"torn\", \"stuck\", \"leaked\", \"reused\"}
  --patience N    seconds in which a topic must flow again (default 30)
  --inject FAULT  torn, reused, stuck or leaked: makes this fault on purpose, to show that it is found
  NODE-COMMAND    starts a BEAM node that plays its part as its environment (CHAOS_*) says; none: no nodes
";

/// A call of the program.
pub enum Request {
    /// Show the help.
    Help,
    /// The whole run.
    Ring {
        /// How it goes.
        settings: Settings,
        /// Whether the last line is for programs.
        json: bool,
    },
    /// Be one of its publishers.
    Publish {
        /// The topic's number in the plan.
        number: usize,
        /// Its name.
        topic: Topic,
        /// Whether to spoil messages.
        corrupt: bool,
    },
    /// Be one of its readers.
    Subscribe {
        /// The topic's number in the plan.
        number: usize,
        /// Its name.
        topic: Topic,
        /// How to read.
        manner: Manner,
        /// Where to note what was accepted.
        log: PathBuf,
    },
}

const VERBS: &str = "ring";

/// Reads the arguments, without the program's name.
pub fn parse(arguments: impl IntoIterator<Item = String>) -> Result<Request, Failure> {
    let mut arguments = arguments.into_iter();
    let verb = arguments
        .next()
        .ok_or_else(|| Failure::Usage(format!("no verb was given; accepted: {VERBS}")))?;
    let rest: Vec<String> = arguments.collect();
    match verb.as_str() {
        "--help" => Ok(Request::Help),
        "ring" => ring(rest),
        "publish" | "subscribe" => peer(&verb, rest),
        _ => Err(Failure::Usage(format!(
            "there is no verb {verb:?}; accepted: {VERBS}"
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
            "--kills" => settings.kills = arguments.parse("a number from 1", |&kills| kills > 0)?,
            "--seed" => settings.seed = arguments.parse("a number from 0", |_| true)?,
            "--patience" => {
                let seconds = arguments.parse("a number of seconds from 1", |&n| n > 0)?;
                settings.patience = Duration::from_secs(seconds);
            }
            "--inject" => {
                settings.inject = Some(arguments.read("torn, reused, stuck, leaked", inject)?);
            }
            "--json" => json = true,
            _ => return Ok(Request::Help),
        }
    }
    Ok(Request::Ring { settings, json })
}

fn inject(text: &str) -> Option<Inject> {
    match text {
        "torn" => Some(Inject::Torn),
        "reused" => Some(Inject::Reused),
        "stuck" => Some(Inject::Stuck),
        "leaked" => Some(Inject::Leaked),
        _ => None,
    }
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
    let (mut manner, mut corrupt) = (Manner::Steady, false);
    while let Some(option) = arguments.next()? {
        match option {
            "--number" => {
                number = Some(arguments.parse("a topic's number", |&n| n < LINES.len())?);
            }
            "--topic" => {
                topic = Some(arguments.read("a topic's name", |text| Topic::new(text).ok())?);
            }
            "--log" => log = Some(arguments.path("a file")?),
            "--restless" => manner = Manner::Restless,
            "--leasing" => manner = Manner::Leasing,
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
        manner,
        log: required(log, "--log", "a file")?,
    })
}
