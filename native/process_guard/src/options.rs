//! The command line.

use std::ffi::OsString;
use std::time::Duration;

use crate::output::Speech;
use program::nearest::hint;

pub const HELP: &str = "\
Run a program that cannot outlive its supervisor.

usage: process_guard [OPTION N]... [--] PROGRAM [ARGUMENT...]

  --grace-ms N          time between SIGTERM and SIGKILL, 0 to 60000 (default 500)
  --halt-ms N           kill it when a signal halts it for so long, 0 to 3600000 (default: never)
  --nice N              how much the program gives way to others, 0 to 19 (default 0)
  --lines-per-second N  lines of its output that go on, ten times as many at once, 1 to 100000
                        (default 100)
  --frames N            speak frames, at most N of them ahead of the supervisor, 1 to 1024
  -h, --help            this text
  -V, --version         the version
";

const KNOWN: &[&str] = &[
    "--grace-ms",
    "--halt-ms",
    "--nice",
    "--lines-per-second",
    "--frames",
    "--help",
    "--version",
];

const DEFAULT_GRACE: Duration = Duration::from_millis(500);
const DEFAULT_LINES_PER_SECOND: u32 = 100;

/// The program to run, how long it may take to end, and how much it may say.
#[derive(Debug, PartialEq)]
pub struct Command {
    pub program: OsString,
    pub arguments: Vec<OsString>,
    pub grace: Duration,
    pub halt: Option<Duration>,
    pub nice: i32,
    pub lines_per_second: u32,
    pub speech: Speech,
}

/// What the command line asks for.
#[derive(Debug, PartialEq)]
pub enum Request {
    Help,
    Version,
    Run(Command),
}

pub fn parse(arguments: impl Iterator<Item = OsString>) -> Result<Request, String> {
    let mut arguments = arguments.peekable();
    let mut command = Command {
        program: OsString::new(),
        arguments: Vec::new(),
        grace: DEFAULT_GRACE,
        halt: None,
        nice: 0,
        lines_per_second: DEFAULT_LINES_PER_SECOND,
        speech: Speech::Plain,
    };
    while let Some(option) = arguments.next_if(is_option) {
        match option.to_str() {
            Some("--help" | "-h") => return Ok(Request::Help),
            Some("--version" | "-V") => return Ok(Request::Version),
            Some("--") => break,
            Some(name) => set(&mut command, name, &mut arguments)?,
            None => return Err(unknown(&option.to_string_lossy())),
        }
    }
    command.program = arguments
        .next()
        .ok_or("no program given; usage: process_guard [OPTION N]... [--] PROGRAM [ARGUMENT...]")?;
    command.arguments = arguments.collect();
    Ok(Request::Run(command))
}

/// Other letters with one dash may begin a program's name.
fn is_option(argument: &OsString) -> bool {
    let text = argument.to_string_lossy();
    text.starts_with("--") || text == "-h" || text == "-V"
}

fn set(
    command: &mut Command,
    option: &str,
    values: &mut impl Iterator<Item = OsString>,
) -> Result<(), String> {
    let mut number = |least, most| number(option, least, most, values.next());
    match option {
        "--grace-ms" => command.grace = Duration::from_millis(number(0, 60_000)?.into()),
        "--halt-ms" => command.halt = Some(Duration::from_millis(number(0, 3_600_000)?.into())),
        "--nice" => command.nice = number(0, 19)?.cast_signed(),
        "--lines-per-second" => command.lines_per_second = number(1, 100_000)?,
        "--frames" => {
            command.speech = Speech::Frames {
                window: number(1, 1024)?,
            }
        }
        _ => return Err(unknown(option)),
    }
    Ok(())
}

fn unknown(option: &str) -> String {
    format!(
        "unknown option {option}{} accepted: --grace-ms N, --halt-ms N, --nice N, \
         --lines-per-second N, --frames N, --help, --version",
        hint(option, KNOWN.iter().copied())
    )
}

fn number(option: &str, least: u32, most: u32, value: Option<OsString>) -> Result<u32, String> {
    let text = value.ok_or_else(|| format!("{option} needs a number"))?;
    text.to_str()
        .and_then(|text| text.parse().ok())
        .filter(|number| (least..=most).contains(number))
        .ok_or_else(|| {
            format!(
                "{option} takes a whole number from {least} to {most}, got {}",
                text.display()
            )
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse_all(arguments: &[&str]) -> Result<Request, String> {
        parse(arguments.iter().map(OsString::from))
    }

    #[test]
    fn everything_after_the_program_is_its_own() {
        let Ok(Request::Run(command)) = parse_all(&["--grace-ms", "20", "echo", "--help"]) else {
            panic!()
        };
        assert_eq!(command.arguments, ["--help"]);
        assert_eq!(command.grace, Duration::from_millis(20));
    }

    #[test]
    fn two_dashes_end_the_options() {
        let Ok(Request::Run(command)) = parse_all(&["--", "--odd-name"]) else {
            panic!()
        };
        assert_eq!(command.program, "--odd-name");
    }

    #[test]
    fn help_and_version_have_a_letter_each() {
        for help in ["-h", "--help"] {
            assert_eq!(parse_all(&[help]), Ok(Request::Help));
        }
        for version in ["-V", "--version"] {
            assert_eq!(parse_all(&[version]), Ok(Request::Version));
        }
    }

    #[test]
    fn a_wrong_option_is_named() {
        let slip = parse_all(&["--gracems", "1", "echo"]).unwrap_err();
        assert!(
            slip.contains("--gracems; did you mean --grace-ms?"),
            "{slip}"
        );
        assert!(
            parse_all(&["--speed", "echo"])
                .unwrap_err()
                .contains("unknown option --speed")
        );
        assert!(
            parse_all(&["--grace-ms", "soon", "echo"])
                .unwrap_err()
                .contains("got soon")
        );
        assert!(
            parse_all(&["--nice", "20", "echo"])
                .unwrap_err()
                .contains("0 to 19, got 20")
        );
        assert!(
            parse_all(&["--lines-per-second", "0", "echo"])
                .unwrap_err()
                .contains("1 to 100000, got 0")
        );
        assert!(
            parse_all(&["--frames"])
                .unwrap_err()
                .contains("needs a number")
        );
        assert!(parse_all(&[]).unwrap_err().contains("no program given"));
    }
}
