//! The command line.

use std::ffi::OsString;
use std::time::Duration;

pub const HELP: &str = "\
Run a program that cannot outlive its supervisor.

usage: process_guard [--grace-ms N] [--nice N] [--] PROGRAM [ARGUMENT...]

  --grace-ms N   time between SIGTERM and SIGKILL, 0 to 60000 (default 500)
  --nice N       how much the program gives way to others, 0 to 19 (default 0)
  --help         this text
";

const DEFAULT_GRACE: Duration = Duration::from_millis(500);

/// The program to run and how long it may take to end.
#[derive(Debug, PartialEq)]
pub struct Command {
    pub program: OsString,
    pub arguments: Vec<OsString>,
    pub grace: Duration,
    pub nice: i32,
}

/// What the command line asks for.
#[derive(Debug, PartialEq)]
pub enum Request {
    Help,
    Run(Command),
}

pub fn parse(arguments: impl Iterator<Item = OsString>) -> Result<Request, String> {
    let mut arguments = arguments.peekable();
    let mut grace = DEFAULT_GRACE;
    let mut nice = 0;
    while let Some(option) =
        arguments.next_if(|argument| argument.to_string_lossy().starts_with("--"))
    {
        match option.to_str() {
            Some("--help") => return Ok(Request::Help),
            Some("--grace-ms") => {
                grace = Duration::from_millis(number("--grace-ms", 60_000, arguments.next())?);
            }
            Some("--nice") => nice = number("--nice", 19, arguments.next())? as i32,
            Some("--") => break,
            _ => {
                let option = option.display();
                return Err(format!(
                    "unknown option {option}; accepted: --grace-ms N, --nice N, --help"
                ));
            }
        }
    }
    let program = arguments.next().ok_or(
        "no program given; usage: process_guard [--grace-ms N] [--nice N] [--] PROGRAM [ARGUMENT...]",
    )?;
    let arguments = arguments.collect();
    Ok(Request::Run(Command {
        program,
        arguments,
        grace,
        nice,
    }))
}

fn number(option: &str, most: u64, value: Option<OsString>) -> Result<u64, String> {
    let text = value.ok_or_else(|| format!("{option} needs a number"))?;
    text.to_str()
        .and_then(|text| text.parse().ok())
        .filter(|number| *number <= most)
        .ok_or_else(|| {
            format!(
                "{option} takes a whole number from 0 to {most}, got {}",
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
    fn a_wrong_option_is_named() {
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
        assert!(parse_all(&[]).unwrap_err().contains("no program given"));
    }
}
