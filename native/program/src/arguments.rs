//! Options as our programs take them: `--long-name VALUE` or `--long-name=VALUE`. Only help and
//! version have letters too: `-h`, `-V`.
//!
//! ```
//! use program::arguments::Arguments;
//!
//! let mut arguments = Arguments::new(["--rate", "30"], &["--rate", "--help"]);
//! while let Some(option) = arguments.next()? {
//!     match option {
//!         "--rate" => {
//!             let rate: f64 = arguments.parse("a number of hertz", |&hertz| hertz > 0.0)?;
//!             assert_eq!(rate, 30.0);
//!         }
//!         _ => {}
//!     }
//! }
//! # Ok::<(), program::Failure>(())
//! ```

use crate::Failure;
use crate::nearest::hint;
use std::ffi::OsString;
use std::path::PathBuf;
use std::str::FromStr;

/// One of the arguments of a call.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Argument {
    /// An option that is known.
    Option(&'static str),
    /// What begins with no dash, or stands behind `--`.
    Plain(OsString),
}

/// The arguments of a call, read one after the other.
#[derive(Debug)]
pub struct Arguments {
    parser: lexopt::Parser,
    known: &'static [&'static str],
    current: &'static str,
}

impl Arguments {
    /// Reads `arguments`, without the program's name; `known` are the options that exist, as they are typed.
    pub fn new<A: Into<OsString>>(
        arguments: impl IntoIterator<Item = A>,
        known: &'static [&'static str],
    ) -> Arguments {
        let arguments: Vec<OsString> = arguments.into_iter().map(Into::into).collect();
        Arguments {
            parser: lexopt::Parser::from_args(arguments),
            known,
            current: "",
        }
    }

    /// The next option, as it is typed; `None` after the last.
    #[expect(
        clippy::should_implement_trait,
        reason = "its errors end the reading, so it is no iterator"
    )]
    pub fn next(&mut self) -> Result<Option<&'static str>, Failure> {
        match self.next_argument()? {
            None => Ok(None),
            Some(Argument::Option(option)) => Ok(Some(option)),
            Some(Argument::Plain(value)) => Err(self.unknown(&value.to_string_lossy())),
        }
    }

    /// The next argument of a program that takes others than options too; `None` after the last.
    pub fn next_argument(&mut self) -> Result<Option<Argument>, Failure> {
        let typed = match self.parser.next() {
            Ok(None) => return Ok(None),
            Ok(Some(lexopt::Arg::Long(name))) => format!("--{name}"),
            Ok(Some(lexopt::Arg::Short('h'))) => "--help".to_owned(),
            Ok(Some(lexopt::Arg::Short('V'))) => "--version".to_owned(),
            Ok(Some(lexopt::Arg::Short(letter))) => format!("-{letter}"),
            Ok(Some(lexopt::Arg::Value(value))) => return Ok(Some(Argument::Plain(value))),
            Err(_) => return Err(self.refuse("a value", "no value")),
        };
        match self.known.iter().find(|&&known| known == typed) {
            Some(&known) => {
                self.current = known;
                Ok(Some(Argument::Option(known)))
            }
            None => Err(self.unknown(&typed)),
        }
    }

    fn unknown(&self, typed: &str) -> Failure {
        Failure::Usage(format!(
            "there is no option {typed:?}{} accepted: {}",
            hint(typed, self.known.iter().copied()),
            self.known.join(" ")
        ))
    }

    /// The value of the current option, read from its text, if it passes `check`. `accepted` says what would.
    pub fn parse<T: FromStr>(
        &mut self,
        accepted: &str,
        check: impl FnOnce(&T) -> bool,
    ) -> Result<T, Failure> {
        let value = self.value(accepted)?;
        value
            .to_str()
            .and_then(|text| text.parse().ok())
            .filter(check)
            .ok_or_else(|| self.refuse(&format!("{value:?}"), accepted))
    }

    /// The value of the current option as `read` makes it from its text.
    pub fn read<T>(
        &mut self,
        accepted: &str,
        read: impl FnOnce(&str) -> Option<T>,
    ) -> Result<T, Failure> {
        let value = self.value(accepted)?;
        value
            .to_str()
            .and_then(read)
            .ok_or_else(|| self.refuse(&format!("{value:?}"), accepted))
    }

    /// The value of the current option as a path, whatever its letters.
    pub fn path(&mut self, accepted: &str) -> Result<PathBuf, Failure> {
        self.value(accepted).map(PathBuf::from)
    }

    fn value(&mut self, accepted: &str) -> Result<OsString, Failure> {
        self.parser
            .value()
            .map_err(|_| self.refuse("no value", accepted))
    }

    fn refuse(&self, given: &str, accepted: &str) -> Failure {
        Failure::Usage(format!(
            "{} was given {given}; accepted: {accepted}",
            self.current
        ))
    }
}

/// The value of an option that must be there.
pub fn required<T>(value: Option<T>, option: &str, accepted: &str) -> Result<T, Failure> {
    value.ok_or_else(|| Failure::Usage(format!("{option} is missing; accepted: {accepted}")))
}
