//! What `ganglion` was called for.

use crate::verbs::{self, Verb};
use conduit_ring::Topic;
use program::Failure;
use program::arguments::{Argument, Arguments};
use program::nearest::hint;
use std::ffi::OsString;
use std::time::Duration;

const TOPIC: &str = "a ring topic, 1 to 200 of A-Z a-z 0-9 _ . -";
const SECONDS: &str = "0.01 to 3600 seconds";

/// What the program was called for.
pub enum Call {
    /// To say how it is called.
    Help(String),
    /// To say its version.
    Version,
    /// To do what a verb does.
    Run(&'static Verb, Options),
}

/// The options of all verbs; which of them a verb takes stands in its [`Verb::options`].
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// What the verb is about. There, if the verb takes one.
    topic: Option<Topic>,
    /// JSON instead of text.
    pub json: bool,
    /// Topics of other names are passed over.
    pub prefix: String,
    /// How many messages or lines are enough.
    pub count: Option<u64>,
    /// Nothing is to be decoded.
    pub raw: bool,
    /// To wait for a topic that is not there.
    pub wait: bool,
    /// To begin with the newest message that is there.
    pub latest: bool,
    /// From line to line.
    pub every: Duration,
    /// How far back a line looks.
    pub window: Duration,
    /// How long to look in order to tell a rate.
    pub look: Duration,
    /// To repair.
    pub fix: bool,
    /// To leave files for the successors of dead publishers.
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
    /// What the verb is about.
    ///
    /// # Panics
    /// In a verb that takes no topic.
    pub fn topic(&self) -> &Topic {
        self.topic.as_ref().expect("the verb takes a topic")
    }
}

/// Reads the arguments, without the program's name.
pub fn read<A: Into<OsString>>(arguments: impl IntoIterator<Item = A>) -> Result<Call, Failure> {
    let mut arguments = arguments.into_iter().map(Into::into);
    let Some(first) = arguments.next() else {
        let verbs = verbs::names().join(" ");
        return Err(usage(format!("a verb is missing; accepted: {verbs}")));
    };
    match first.to_string_lossy().as_ref() {
        "-h" | "--help" => Ok(Call::Help(verbs::help())),
        "-V" | "--version" => Ok(Call::Version),
        "help" => help_call(arguments),
        name => verb_call(verb(name)?, arguments),
    }
}

fn help_call(mut arguments: impl Iterator<Item = OsString>) -> Result<Call, Failure> {
    let Some(name) = arguments.next() else {
        return Ok(Call::Help(verbs::help()));
    };
    if let Some(more) = arguments.next() {
        return Err(usage(format!(
            "help takes one verb, got {more:?} too; accepted: help VERB"
        )));
    }
    match name.to_string_lossy().as_ref() {
        "help" | "-h" | "--help" => Ok(Call::Help(verbs::help())),
        name => verb(name).map(|verb| Call::Help(verb.help.into())),
    }
}

fn verb(name: &str) -> Result<&'static Verb, Failure> {
    let known = verbs::ALL.iter().find(|verb| verb.name == name);
    known.copied().ok_or_else(|| unknown(name))
}

/// What is neither a verb nor an option that stands before one.
fn unknown(name: &str) -> Failure {
    let verbs = verbs::names();
    let (what, accepted) = if name.starts_with('-') {
        (
            "option",
            [&["--help", "--version"], verbs.as_slice()].concat(),
        )
    } else {
        ("verb", [verbs.as_slice(), &["help"]].concat())
    };
    let hint = hint(name, accepted.iter().copied());
    usage(format!(
        "there is no {what} {name:?}{hint} accepted: {}",
        accepted.join(" ")
    ))
}

fn verb_call(
    verb: &'static Verb,
    arguments: impl Iterator<Item = OsString>,
) -> Result<Call, Failure> {
    let mut arguments = Arguments::new(arguments, verb.options);
    let mut options = Options::default();
    while let Some(argument) = arguments.next_argument()? {
        match argument {
            Argument::Option("--help") => return Ok(Call::Help(verb.help.into())),
            Argument::Option(option) => take(option, &mut arguments, &mut options)?,
            Argument::Plain(name) => take_topic(verb, &name.to_string_lossy(), &mut options)?,
        }
    }
    if verb.takes_topic && options.topic.is_none() {
        return Err(usage(format!("TOPIC is missing; accepted: {TOPIC}")));
    }
    Ok(Call::Run(verb, options))
}

fn take(option: &str, arguments: &mut Arguments, options: &mut Options) -> Result<(), Failure> {
    match option {
        "--json" => options.json = true,
        "--raw" => options.raw = true,
        "--wait" => options.wait = true,
        "--latest" => options.latest = true,
        "--fix" => options.fix = true,
        "--keep-dead" => options.keep_dead = true,
        "--prefix" => {
            options.prefix = arguments.parse("how the topics' names begin", |name: &String| {
                !name.is_empty()
            })?;
        }
        "--count" => {
            options.count = Some(arguments.parse("a number from 1 on", |&count| count > 0)?);
        }
        "--every" => options.every = seconds(arguments)?,
        "--window" => options.window = seconds(arguments)?,
        "--look" => options.look = seconds(arguments)?,
        _ => unreachable!("{option} is in a verb's options and not read"),
    }
    Ok(())
}

fn seconds(arguments: &mut Arguments) -> Result<Duration, Failure> {
    let given: f64 = arguments.parse(SECONDS, |s| (0.01..=3600.0).contains(s))?;
    Ok(Duration::from_secs_f64(given))
}

fn take_topic(verb: &Verb, name: &str, options: &mut Options) -> Result<(), Failure> {
    if !verb.takes_topic || options.topic.is_some() {
        let accepted = verb.options.join(" ");
        return Err(usage(format!(
            "{} takes no {name:?}; accepted: {accepted}",
            verb.name
        )));
    }
    let topic = Topic::found(name)
        .map_err(|_| usage(format!("TOPIC was given {name:?}; accepted: {TOPIC}")))?;
    options.topic = Some(topic);
    Ok(())
}

fn usage(text: String) -> Failure {
    Failure::Usage(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(arguments: &[&str]) -> Options {
        match read(arguments) {
            Ok(Call::Run(_, options)) => options,
            Ok(Call::Help(_) | Call::Version) => panic!("no verb"),
            Err(failure) => panic!("{failure}"),
        }
    }

    fn refusal(arguments: &[&str]) -> String {
        match read(arguments) {
            Err(Failure::Usage(text)) => text,
            Err(other) => panic!("{other}"),
            Ok(_) => panic!("accepted"),
        }
    }

    #[test]
    fn a_verb_takes_its_topic_before_and_after_its_options() {
        let before = options(&["hz", "imu", "--json", "--window", "0.5"]);
        let after = options(&["hz", "--json", "--window=0.5", "imu"]);
        assert_eq!(before, after);
        assert_eq!(before.topic().name(), "imu");
        assert_eq!(before.window, Duration::from_millis(500));
    }

    #[test]
    fn a_wrong_call_is_told_what_is_accepted() {
        assert!(refusal(&[]).contains("accepted: topics info echo hz bw latency doctor"));
        assert!(refusal(&["hertz", "imu"]).contains("no verb \"hertz\""));
        assert!(refusal(&["hz"]).contains("TOPIC is missing"));
        assert!(refusal(&["hz", "a/b"]).contains("TOPIC was given \"a/b\""));
        assert!(refusal(&["hz", "a", "b"]).contains("takes no \"b\""));
        assert!(refusal(&["topics", "a"]).contains("takes no \"a\""));
        assert!(refusal(&["hz", "a", "--fix"]).contains("no option \"--fix\""));
        assert!(refusal(&["hz", "a", "--window", "0"]).contains("0.01 to 3600 seconds"));
    }

    #[test]
    fn a_slip_is_told_with_what_was_meant() {
        let refused = refusal(&["topcis"]);
        let expected = "there is no verb \"topcis\"; did you mean topics? accepted: topics info ";
        assert!(refused.starts_with(expected), "{refused}");
        assert!(refusal(&["--hlep"]).contains("did you mean --help? accepted: --help --version"));
        assert!(refusal(&["hz", "a", "--widow", "1"]).contains("did you mean --window?"));
        assert!(refusal(&["help", "ech"]).contains("did you mean echo?"));
        assert!(refusal(&["help", "echo", "hz"]).contains("help takes one verb"));
    }

    #[test]
    fn help_and_version_have_several_names() {
        for given in [&["-h"][..], &["--help"], &["help"], &["help", "help"]] {
            assert!(matches!(read(given), Ok(Call::Help(text)) if text == verbs::help()));
        }
        for given in [&["hz", "-h"][..], &["hz", "imu", "--help"], &["help", "hz"]] {
            let told = "ganglion hz: ";
            assert!(matches!(read(given), Ok(Call::Help(text)) if text.starts_with(told)));
        }
        for given in ["-V", "--version"] {
            assert!(matches!(read([given]), Ok(Call::Version)));
        }
    }

    #[test]
    fn every_option_of_every_verb_is_read_and_stands_in_its_help() {
        for verb in verbs::ALL {
            assert!(verb.help.starts_with(&format!("ganglion {}: ", verb.name)));
            assert!(
                verb.help
                    .contains(&format!("Usage: ganglion {}", verb.name))
            );
            for option in verb.options {
                assert!(verb.help.contains(option), "{} {option}", verb.name);
                let given = [
                    Some(verb.name),
                    verb.takes_topic.then_some("imu"),
                    Some(option),
                ];
                let given: Vec<_> = given.into_iter().flatten().collect();
                if let Err(failure) = read(given) {
                    assert!(
                        failure.to_string().contains("was given no value"),
                        "{failure}"
                    );
                }
            }
        }
    }
}
