//! The camera's options.

use crate::scene::{HEIGHTS, WIDTHS};
use conduit_ring::Topic;
use program::Failure;
use program::arguments::{Arguments, required};
use std::ffi::OsString;
use std::path::PathBuf;

/// The text that `--help` prints.
pub const HELP: &str = "\
camera: publishes grey frames on a ring topic

Usage: camera --topic NAME [options]

  --topic NAME        ring topic, 1 to 200 characters of A-Z a-z 0-9 _ . -
  --rate HZ           frames per second, 0.01 to 1000; default 30
  --width PIXELS      width of the rendered scene, 320 to 7680; default 640
  --height PIXELS     height of the rendered scene, 240 to 4320; default 480
  --frames DIR        show the photographs (.jpg, .jpeg, .png) of a folder in the order of their
                      names, in a loop, instead of the scene
  --slots COUNT       slots of the ring, a power of two from 2 to 64; default 4
  --check             check whether --frames can be used and exit; needs no topic
  --exit-with-stdin   exit when stdin closes
  -h, --help          print this help
  -V, --version       print the version
";

const KNOWN: &[&str] = &[
    "--topic",
    "--rate",
    "--width",
    "--height",
    "--frames",
    "--slots",
    "--check",
    "--exit-with-stdin",
    "--version",
    "--help",
];

const TOPIC: &str = "a ring topic, 1 to 200 characters of A-Z a-z 0-9 _ . -";

/// The settings of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The ring topic to publish on.
    pub topic: Topic,
    /// Frames per second.
    pub rate_hz: f64,
    /// The pictures to show.
    pub picture: Picture,
    /// Slots of the ring.
    pub slots: u32,
    /// Whether the camera exits when stdin closes.
    pub exit_with_stdin: bool,
}

/// The pictures to show.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Picture {
    /// The rendered scene in this size.
    Scene {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// The photographs of a folder.
    Photographs(PathBuf),
}

/// The action that the command line requests.
#[derive(Debug, Clone, PartialEq)]
pub enum Call {
    /// Print the help.
    Help,
    /// Print the version.
    Version,
    /// Check whether these pictures can be used.
    Check(Picture),
    /// Run the camera.
    Run(Options),
}

impl Call {
    /// Parses the arguments, without the program's name.
    ///
    /// # Errors
    /// [`Failure::Usage`] when an option is unknown, missing or has an invalid value.
    pub fn parse<A: Into<OsString>>(
        arguments: impl IntoIterator<Item = A>,
    ) -> Result<Call, Failure> {
        let mut arguments = Arguments::new(arguments, KNOWN);
        let (mut topic, mut folder) = (None, None);
        let (mut width, mut height) = (None, None);
        let (mut rate_hz, mut slots) = (30.0, 4);
        let (mut check, mut exit_with_stdin) = (false, false);
        while let Some(option) = arguments.next()? {
            match option {
                "--topic" => topic = Some(arguments.read(TOPIC, |name| Topic::new(name).ok())?),
                "--rate" => rate_hz = arguments.parse("0.01 to 1000 hertz", is_rate)?,
                "--width" => {
                    width = Some(arguments.parse("320 to 7680 pixels", |w| WIDTHS.contains(w))?);
                }
                "--height" => {
                    height =
                        Some(arguments.parse("240 to 4320 pixels", |h| HEIGHTS.contains(h))?);
                }
                "--frames" => folder = Some(arguments.path("a folder of photographs")?),
                "--slots" => slots = arguments.parse("a power of two from 2 to 64", is_slots)?,
                "--check" => check = true,
                "--exit-with-stdin" => exit_with_stdin = true,
                "--version" => return Ok(Call::Version),
                _ => return Ok(Call::Help),
            }
        }
        if check {
            return Ok(Call::Check(picture(folder, width, height)?));
        }
        Ok(Call::Run(Options {
            topic: required(topic, "--topic", TOPIC)?,
            rate_hz,
            picture: picture(folder, width, height)?,
            slots,
            exit_with_stdin,
        }))
    }
}

fn is_rate(hertz: &f64) -> bool {
    (0.01..=1000.0).contains(hertz)
}

fn is_slots(count: &u32) -> bool {
    count.is_power_of_two() && (2..=64).contains(count)
}

fn picture(
    folder: Option<PathBuf>,
    width: Option<u32>,
    height: Option<u32>,
) -> Result<Picture, Failure> {
    match folder {
        None => Ok(Picture::Scene {
            width: width.unwrap_or(640),
            height: height.unwrap_or(480),
        }),
        Some(folder) if width.is_none() && height.is_none() => Ok(Picture::Photographs(folder)),
        Some(_) => Err(Failure::Usage(
            "--frames option cannot be combined with --width or --height: \
             photographs have a size of their own"
                .into(),
        )),
    }
}
