//! The command line.

use std::ffi::OsString;
use std::time::Duration;

use crate::protocol::Protocol;
use program::nearest::hint;

pub const HELP: &str = "\
Run a program and end it, with everything it started, when the supervisor ends.

usage: process_guard [OPTION N]... [--] PROGRAM [ARGUMENT...]

  --grace-ms N          time between SIGTERM and SIGKILL, 0 to 60000 (default 500)
  --halt-ms N           kill a program that a signal stops for so long, 0 to 3600000
                        (default: never)
  --nice N              nice value of the program, 0 to 19 (default 0)
  --lines-per-second N  rate limit of the program's output, with bursts of ten times as many
                        lines, 1 to 100000 (default 100)
  --frames N            write frames, at most N of them ahead of the supervisor, 1 to 1024
  -h, --help            print this help
  -V, --version         print the version
";

const USAGE: &str = "usage: process_guard [OPTION N]... [--] PROGRAM [ARGUMENT...]";

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

/// The program to run, the time that it has to end, and the limits of its output.
#[derive(Debug, PartialEq)]
pub struct Command {
    pub program: OsString,
    pub arguments: Vec<OsString>,
    pub grace: Duration,
    pub halt: Option<Duration>,
    pub nice: i32,
    pub lines_per_second: u32,
    pub protocol: Protocol,
}

/// The action that the command line requests.
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
        protocol: Protocol::Lines,
    };
    while let Some(option) = arguments.next_if(is_option) {
        match option.to_str() {
            Some("--help" | "-h") => return Ok(Request::Help),
            Some("--version" | "-V") => return Ok(Request::Version),
            Some("--") => break,
            Some(name) => set(&mut command, name, &mut arguments)?,
            None => return Err(unknown_option(&option.to_string_lossy())),
        }
    }
    command.program = arguments
        .next()
        .ok_or_else(|| format!("PROGRAM is missing; {USAGE}"))?;
    command.arguments = arguments.collect();
    Ok(Request::Run(command))
}

/// Returns whether `argument` is an option. Any other argument with a single dash may be a
/// program's name.
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
            command.protocol = Protocol::Frames {
                window: number(1, 1024)?,
            }
        }
        _ => return Err(unknown_option(option)),
    }
    Ok(())
}

fn unknown_option(option: &str) -> String {
    format!(
        "unknown option {option}{} expected one of: --grace-ms N, --halt-ms N, --nice N, \
         --lines-per-second N, --frames N, --help, --version",
        hint(option, KNOWN.iter().copied())
    )
}

fn number(option: &str, least: u32, most: u32, value: Option<OsString>) -> Result<u32, String> {
    let invalid = |got: &str| {
        format!(
            "invalid value for {option} option: \
             expected a whole number from {least} to {most}, got: {got}"
        )
    };
    let text = value.ok_or_else(|| invalid("no value"))?;
    text.to_str()
        .and_then(|text| text.parse().ok())
        .filter(|number| (least..=most).contains(number))
        .ok_or_else(|| invalid(&format!("{text:?}")))
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
    fn help_and_version_have_a_short_form_each() {
        for help in ["-h", "--help"] {
            assert_eq!(parse_all(&[help]), Ok(Request::Help));
        }
        for version in ["-V", "--version"] {
            assert_eq!(parse_all(&[version]), Ok(Request::Version));
        }
    }

    #[test]
    fn the_error_for_a_wrong_option_names_it() {
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
                .contains("got: \"soon\"")
        );
        assert!(
            parse_all(&["--nice", "20", "echo"])
                .unwrap_err()
                .contains("0 to 19, got: \"20\"")
        );
        assert!(
            parse_all(&["--lines-per-second", "0", "echo"])
                .unwrap_err()
                .contains("1 to 100000, got: \"0\"")
        );
        assert!(
            parse_all(&["--frames"])
                .unwrap_err()
                .contains("got: no value")
        );
        assert!(parse_all(&[]).unwrap_err().contains("PROGRAM is missing"));
    }
}
