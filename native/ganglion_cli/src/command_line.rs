//! Parsing of the command line into a verb and its options.

use crate::options::{Options, TOPIC};
use crate::verb::Verb;
use crate::verbs;
use program::Failure;
use program::arguments::{Argument, Arguments};
use program::nearest::hint;
use std::ffi::OsString;

/// The action that the command line requests.
pub enum Call {
    /// Print this help text.
    Help(String),
    /// Print the version.
    Version,
    /// Run a verb.
    Run(&'static Verb, Options),
}

/// Parses the arguments, without the program's name.
///
/// # Errors
/// [`Failure::Usage`] when the verb, the topic or an option is unknown, missing or invalid.
pub fn parse<A: Into<OsString>>(arguments: impl IntoIterator<Item = A>) -> Result<Call, Failure> {
    let mut arguments = arguments.into_iter().map(Into::into);
    let Some(first) = arguments.next() else {
        let verbs = names().join(" ");
        return Err(usage(format!("VERB is missing; expected one of: {verbs}")));
    };
    match first.to_string_lossy().as_ref() {
        "-h" | "--help" => Ok(Call::Help(help())),
        "-V" | "--version" => Ok(Call::Version),
        "help" => parse_help(arguments),
        name => parse_verb(find_verb(name)?, arguments),
    }
}

fn parse_help(mut arguments: impl Iterator<Item = OsString>) -> Result<Call, Failure> {
    let Some(name) = arguments.next() else {
        return Ok(Call::Help(help()));
    };
    if let Some(extra) = arguments.next() {
        return Err(usage(format!(
            "unknown argument {extra:?}; expected help with a single VERB"
        )));
    }
    match name.to_string_lossy().as_ref() {
        "help" | "-h" | "--help" => Ok(Call::Help(help())),
        name => find_verb(name).map(|verb| Call::Help(verb.help.into())),
    }
}

fn find_verb(name: &str) -> Result<&'static Verb, Failure> {
    let known = verbs::ALL.iter().find(|verb| verb.name == name);
    known.copied().ok_or_else(|| unknown(name))
}

/// Returns the error for a first argument that is neither a verb nor an option.
fn unknown(name: &str) -> Failure {
    let verbs = names();
    let (kind, known) = if name.starts_with('-') {
        (
            "option",
            [&["--help", "--version"], verbs.as_slice()].concat(),
        )
    } else {
        ("verb", [verbs.as_slice(), &["help"]].concat())
    };
    let hint = hint(name, known.iter().copied());
    usage(format!(
        "unknown {kind} {name:?}{hint} expected one of: {}",
        known.join(" ")
    ))
}

fn parse_verb(
    verb: &'static Verb,
    arguments: impl Iterator<Item = OsString>,
) -> Result<Call, Failure> {
    let mut arguments = Arguments::new(arguments, verb.options);
    let mut options = Options::default();
    while let Some(argument) = arguments.next_argument()? {
        match argument {
            Argument::Option("--help") => return Ok(Call::Help(verb.help.into())),
            Argument::Option(option) => options.set(option, &mut arguments)?,
            Argument::Plain(name) => set_topic(verb, &name.to_string_lossy(), &mut options)?,
        }
    }
    if verb.takes_topic && !options.has_topic() {
        return Err(usage(format!("TOPIC is missing; expected {TOPIC}")));
    }
    Ok(Call::Run(verb, options))
}

fn set_topic(verb: &Verb, name: &str, options: &mut Options) -> Result<(), Failure> {
    if !verb.takes_topic || options.has_topic() {
        return Err(usage(format!(
            "unknown argument {name:?} for {}; expected one of: {}",
            verb.name,
            verb.options.join(" ")
        )));
    }
    options.set_topic(name)
}

fn usage(text: String) -> Failure {
    Failure::Usage(text)
}

fn names() -> Vec<&'static str> {
    verbs::ALL.iter().map(|verb| verb.name).collect()
}

/// Returns the text of `ganglion --help`.
fn help() -> String {
    let lines = verbs::ALL.iter().map(|verb| {
        let topic = if verb.takes_topic { " TOPIC" } else { "" };
        let call = format!("{}{topic}", verb.name);
        format!("  {call:<14} {}\n", verb.summary)
    });
    format!(
        "ganglion: shows, measures and repairs the ring topics of this machine\n\n\
         Usage: ganglion VERB [options]\n\n{}\n  \
         -h, --help     print this help; \"ganglion help VERB\" describes a verb\n  \
         -V, --version  print the version\n\n\
         With --json each verb prints one JSON object per line.\n\
         Exit status: 0 for success, 1 for a failure at run time, 2 for a usage error.\n",
        lines.collect::<String>()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn options(arguments: &[&str]) -> Options {
        match parse(arguments) {
            Ok(Call::Run(_, options)) => options,
            Ok(Call::Help(_) | Call::Version) => panic!("no verb"),
            Err(failure) => panic!("{failure}"),
        }
    }

    fn usage_error(arguments: &[&str]) -> String {
        match parse(arguments) {
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
    fn a_usage_error_says_what_was_expected() {
        let verbs = "expected one of: topics info echo hz bw latency doctor";
        assert!(usage_error(&[]).contains(verbs));
        assert!(usage_error(&["hertz", "imu"]).contains("unknown verb \"hertz\""));
        assert!(usage_error(&["hz"]).contains("TOPIC is missing"));
        assert!(usage_error(&["hz", "a/b"]).starts_with("invalid TOPIC: expected a ring topic"));
        assert!(usage_error(&["hz", "a", "b"]).contains("unknown argument \"b\" for hz"));
        assert!(usage_error(&["topics", "a"]).contains("unknown argument \"a\" for topics"));
        assert!(usage_error(&["hz", "a", "--fix"]).contains("unknown option \"--fix\""));
        assert!(usage_error(&["hz", "a", "--window", "0"]).contains("0.01 to 3600 seconds"));
    }

    #[test]
    fn the_error_for_a_mistyped_name_suggests_the_closest_one() {
        let error = usage_error(&["topcis"]);
        let expected = "unknown verb \"topcis\"; did you mean topics? expected one of: topics ";
        assert!(error.starts_with(expected), "{error}");
        let error = usage_error(&["--hlep"]);
        let expected = "did you mean --help? expected one of: --help --version";
        assert!(error.contains(expected), "{error}");
        assert!(usage_error(&["hz", "a", "--widow", "1"]).contains("did you mean --window?"));
        assert!(usage_error(&["help", "ech"]).contains("did you mean echo?"));
        assert!(usage_error(&["help", "echo", "hz"]).contains("a single VERB"));
    }

    #[test]
    fn help_and_version_have_several_forms() {
        for given in [&["-h"][..], &["--help"], &["help"], &["help", "help"]] {
            assert!(matches!(parse(given), Ok(Call::Help(text)) if text == help()));
        }
        for given in [&["hz", "-h"][..], &["hz", "imu", "--help"], &["help", "hz"]] {
            let start = "ganglion hz: ";
            assert!(matches!(parse(given), Ok(Call::Help(text)) if text.starts_with(start)));
        }
        for given in ["-V", "--version"] {
            assert!(matches!(parse([given]), Ok(Call::Version)));
        }
    }

    #[test]
    fn every_option_of_every_verb_is_parsed_and_listed_in_its_help() {
        for verb in verbs::ALL {
            assert!(verb.help.starts_with(&format!("ganglion {}: ", verb.name)));
            let usage = format!("Usage: ganglion {}", verb.name);
            assert!(verb.help.contains(&usage));
            for option in verb.options {
                assert!(verb.help.contains(option), "{} {option}", verb.name);
                let topic = verb.takes_topic.then_some("imu");
                let given = [Some(verb.name), topic, Some(option)];
                let given: Vec<_> = given.into_iter().flatten().collect();
                if let Err(failure) = parse(given) {
                    let text = failure.to_string();
                    assert!(text.ends_with("got: no value"), "{text}");
                }
            }
        }
    }
}
