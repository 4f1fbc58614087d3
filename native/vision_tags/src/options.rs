//! The detector's options.

use crate::detector::{DECIMATIONS, FAMILIES, Settings};
use conduit_ring::Topic;
use program::Failure;
use program::arguments::{Arguments, required};
use std::ffi::OsString;

/// The text that `--help` prints.
pub const HELP: &str = "\
vision_tags: finds AprilTags in the frames of a ring topic

Usage: vision_tags --frames TOPIC --detections TOPIC [options]

  --frames TOPIC      ring topic of the camera's grey frames
  --detections TOPIC  ring topic to publish on, one message per frame
  --imu TOPIC         ring topic of an inertial measurement unit, whose angular speed is published
                      with the tags
  --family NAME       tag36h11, tag25h9 or tag16h5; default tag36h11
  --threads COUNT     number of threads for a frame, 1 to 16; default 1
  --quad-decimate N   detect in an image that is N times smaller (1, 1.5, 2, 3, ... 8), which is
                      faster and misses small tags; default 1
  --refine-edges      align the tags' edges with strong gradients nearby
  --exit-with-stdin   exit when stdin closes
  -h, --help          print this help
  -V, --version       print the version

A topic name has 1 to 200 characters of A-Z a-z 0-9 _ . - and the topic need not exist yet.
";

const KNOWN: &[&str] = &[
    "--frames",
    "--detections",
    "--imu",
    "--family",
    "--threads",
    "--quad-decimate",
    "--refine-edges",
    "--exit-with-stdin",
    "--version",
    "--help",
];

const TOPIC: &str = "a ring topic, 1 to 200 characters of A-Z a-z 0-9 _ . -";

/// The settings of a detector process.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The topic of the frames.
    pub frames: Topic,
    /// The topic to publish detections on.
    pub detections: Topic,
    /// The topic of the inertial measurement unit's samples.
    pub imu: Option<Topic>,
    /// The detector's settings.
    pub settings: Settings,
    /// Whether the process exits when stdin closes.
    pub exit_with_stdin: bool,
}

/// The action that the command line requests.
#[derive(Debug, Clone, PartialEq)]
pub enum Call {
    /// Print the help.
    Help,
    /// Print the version.
    Version,
    /// Run the detector.
    Run(Options),
}

impl Call {
    /// Parses the arguments, without the program's name.
    ///
    /// # Errors
    /// [`Failure::Usage`] when an option is unknown, missing or has an invalid value, or when two
    /// topics are the same.
    pub fn parse<A: Into<OsString>>(
        arguments: impl IntoIterator<Item = A>,
    ) -> Result<Call, Failure> {
        let mut arguments = Arguments::new(arguments, KNOWN);
        let (mut frames, mut detections, mut imu) = (None, None, None);
        let mut settings = Settings::default();
        let mut exit_with_stdin = false;
        while let Some(option) = arguments.next()? {
            match option {
                "--frames" => frames = Some(foreign_topic(&mut arguments)?),
                "--detections" => detections = Some(own_topic(&mut arguments)?),
                "--imu" => imu = Some(foreign_topic(&mut arguments)?),
                "--family" => settings.family = family(&mut arguments)?,
                "--threads" => {
                    settings.threads = arguments.parse("1 to 16", |n| (1..=16).contains(n))?;
                }
                "--quad-decimate" => settings.quad_decimate = decimation(&mut arguments)?,
                "--refine-edges" => settings.refine_edges = true,
                "--exit-with-stdin" => exit_with_stdin = true,
                "--version" => return Ok(Call::Version),
                _ => return Ok(Call::Help),
            }
        }
        let options = Options {
            frames: required(frames, "--frames", TOPIC)?,
            detections: required(detections, "--detections", TOPIC)?,
            imu,
            settings,
            exit_with_stdin,
        };
        options.check()?;
        Ok(Call::Run(options))
    }
}

impl Options {
    /// Checks that the topics differ.
    fn check(&self) -> Result<(), Failure> {
        let read = [Some(&self.frames), self.imu.as_ref()];
        let clash =
            read.contains(&Some(&self.detections)) || self.imu.as_ref() == Some(&self.frames);
        if !clash {
            return Ok(());
        }
        let names = [
            Some(&self.frames),
            self.imu.as_ref(),
            Some(&self.detections),
        ];
        let names: Vec<&str> = names.into_iter().flatten().map(Topic::name).collect();
        Err(Failure::Usage(format!(
            "invalid topics: expected three different topics for --frames, --imu and \
             --detections, got: {}",
            names.join(", ")
        )))
    }
}

/// Reads the name of a topic that this process creates.
fn own_topic(arguments: &mut Arguments) -> Result<Topic, Failure> {
    arguments.read(TOPIC, |name| Topic::new(name).ok())
}

/// Reads the name of a topic that another process creates.
fn foreign_topic(arguments: &mut Arguments) -> Result<Topic, Failure> {
    arguments.read(TOPIC, |name| Topic::found(name).ok())
}

fn family(arguments: &mut Arguments) -> Result<&'static str, Failure> {
    arguments.read(&FAMILIES.join(", "), |name| {
        FAMILIES.into_iter().find(|&family| family == name)
    })
}

fn decimation(arguments: &mut Arguments) -> Result<f32, Failure> {
    arguments.parse("1, 1.5, 2, 3, 4, 5, 6, 7 or 8", |n| DECIMATIONS.contains(n))
}
