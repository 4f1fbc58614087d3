//! Reads a program's arguments: `--long-name VALUE` or `--long-name=VALUE`. Only help and version
//! have short forms: `-h` and `-V`.
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

/// One argument of a command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Argument {
    /// A known option.
    Option(&'static str),
    /// An argument without a leading dash, or any argument after `--`.
    Plain(OsString),
}

/// The arguments of a command line, read one by one.
#[derive(Debug)]
pub struct Arguments {
    parser: lexopt::Parser,
    known: &'static [&'static str],
    current: &'static str,
}

impl Arguments {
    /// Takes `arguments` without the program's name. `known` lists the options that the program
    /// accepts, as they are typed.
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

    /// Returns the next option as it is typed, or `None` after the last one.
    ///
    /// # Errors
    /// [`Failure::Usage`] for an unknown option, for an argument that is no option, and for a
    /// value that follows an option without one.
    #[expect(
        clippy::should_implement_trait,
        reason = "an error ends the reading, so this is not an iterator"
    )]
    pub fn next(&mut self) -> Result<Option<&'static str>, Failure> {
        match self.next_argument()? {
            None => Ok(None),
            Some(Argument::Option(option)) => Ok(Some(option)),
            Some(Argument::Plain(value)) => Err(self.unknown_option(&value.to_string_lossy())),
        }
    }

    /// Returns the next argument, or `None` after the last one. For programs that accept plain
    /// arguments beside options.
    ///
    /// # Errors
    /// [`Failure::Usage`] for an unknown option and for a value that follows an option without
    /// one.
    pub fn next_argument(&mut self) -> Result<Option<Argument>, Failure> {
        let option = match self.parser.next() {
            Ok(None) => return Ok(None),
            Ok(Some(lexopt::Arg::Long(name))) => format!("--{name}"),
            Ok(Some(lexopt::Arg::Short('h'))) => "--help".to_owned(),
            Ok(Some(lexopt::Arg::Short('V'))) => "--version".to_owned(),
            Ok(Some(lexopt::Arg::Short(letter))) => format!("-{letter}"),
            Ok(Some(lexopt::Arg::Value(value))) => return Ok(Some(Argument::Plain(value))),
            Err(lexopt::Error::UnexpectedValue { value, .. }) => {
                return Err(self.invalid_value(&format!("{value:?}"), "no value"));
            }
            Err(error) => return Err(Failure::Usage(error.to_string())),
        };
        match self.known.iter().find(|&&known| known == option) {
            Some(&known) => {
                self.current = known;
                Ok(Some(Argument::Option(known)))
            }
            None => Err(self.unknown_option(&option)),
        }
    }

    fn unknown_option(&self, option: &str) -> Failure {
        Failure::Usage(format!(
            "unknown option {option:?}{} expected one of: {}",
            hint(option, self.known.iter().copied()),
            self.known.join(" ")
        ))
    }

    /// Parses the value of the current option and returns it if `check` accepts it. `expected`
    /// describes an accepted value for the error message.
    ///
    /// # Errors
    /// [`Failure::Usage`] when the value is missing, cannot be parsed or does not pass `check`.
    pub fn parse<T: FromStr>(
        &mut self,
        expected: &str,
        check: impl FnOnce(&T) -> bool,
    ) -> Result<T, Failure> {
        let value = self.value(expected)?;
        value
            .to_str()
            .and_then(|text| text.parse().ok())
            .filter(check)
            .ok_or_else(|| self.invalid_value(&format!("{value:?}"), expected))
    }

    /// Returns the value of the current option as `read` converts it from text.
    ///
    /// # Errors
    /// [`Failure::Usage`] when the value is missing, is not UTF-8 or `read` returns `None`.
    pub fn read<T>(
        &mut self,
        expected: &str,
        read: impl FnOnce(&str) -> Option<T>,
    ) -> Result<T, Failure> {
        let value = self.value(expected)?;
        value
            .to_str()
            .and_then(read)
            .ok_or_else(|| self.invalid_value(&format!("{value:?}"), expected))
    }

    /// Returns the value of the current option as a path, which need not be UTF-8.
    ///
    /// # Errors
    /// [`Failure::Usage`] when the value is missing.
    pub fn path(&mut self, expected: &str) -> Result<PathBuf, Failure> {
        self.value(expected).map(PathBuf::from)
    }

    fn value(&mut self, expected: &str) -> Result<OsString, Failure> {
        self.parser
            .value()
            .map_err(|_| self.invalid_value("no value", expected))
    }

    fn invalid_value(&self, got: &str, expected: &str) -> Failure {
        Failure::Usage(format!(
            "invalid value for {} option: expected {expected}, got: {got}",
            self.current
        ))
    }
}

/// Returns the value of an option that a program cannot do without.
///
/// # Errors
/// [`Failure::Usage`] when `value` is `None`. The message names `option` and describes the
/// expected value.
pub fn required<T>(value: Option<T>, option: &str, expected: &str) -> Result<T, Failure> {
    value
        .ok_or_else(|| Failure::Usage(format!("{option} option is missing; expected {expected}")))
}
