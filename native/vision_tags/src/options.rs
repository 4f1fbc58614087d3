//! The options of the detector's process.

use crate::eye::{DECIMATIONS, FAMILIES, Settings};
use conduit_ring::Topic;
use program::Failure;
use program::arguments::{Arguments, required};
use std::ffi::OsString;

/// What `--help` says.
pub const HELP: &str = "\
vision_tags: finds AprilTags in the frames of a ring topic

Usage: vision_tags --frames TOPIC --detections TOPIC [options]

  --frames TOPIC      ring topic of the camera's grey frames
  --detections TOPIC  ring topic to publish on, a message for each frame that was looked at
  --imu TOPIC         ring topic of an inertial unit, whose angular speed is reported with the tags
  --family NAME       tag36h11, tag25h9 or tag16h5; default tag36h11
  --threads COUNT     1 to 16 threads share the work on a frame; default 1
  --quad-decimate N   look in an image N times smaller (1, 1.5, 2, 3, ... 8): faster, small tags are lost; default 1
  --refine-edges      snap the tags' edges to strong gradients nearby
  --exit-with-stdin   end when stdin does
  -h, --help          this text
  -V, --version       the version

A topic is 1 to 200 of A-Z a-z 0-9 _ . - and need not exist yet.
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

const TOPIC: &str = "a ring topic, 1 to 200 of A-Z a-z 0-9 _ . -";

/// What the process shall do.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Where the frames come from.
    pub frames: Topic,
    /// Where the detections go.
    pub detections: Topic,
    /// Where the samples of the inertial unit come from.
    pub imu: Option<Topic>,
    /// How to look.
    pub settings: Settings,
    /// Whether the end of stdin is its end.
    pub exit_with_stdin: bool,
}

/// What the program was called for.
#[derive(Debug, Clone, PartialEq)]
pub enum Call {
    /// To say how it is called.
    Help,
    /// To say its version.
    Version,
    /// To look for tags.
    Run(Options),
}

impl Call {
    /// Reads the arguments, without the program's name.
    pub fn parse<A: Into<OsString>>(
        arguments: impl IntoIterator<Item = A>,
    ) -> Result<Call, Failure> {
        let mut arguments = Arguments::new(arguments, KNOWN);
        let (mut frames, mut detections, mut imu) = (None, None, None);
        let mut settings = Settings::default();
        let mut exit_with_stdin = false;
        while let Some(option) = arguments.next()? {
            match option {
                "--frames" => frames = Some(topic(&mut arguments)?),
                "--detections" => detections = Some(own_topic(&mut arguments)?),
                "--imu" => imu = Some(topic(&mut arguments)?),
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
    /// What it reads and what it writes cannot be the same.
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
            "--frames, --imu and --detections were given {}; accepted: topics that differ",
            names.join(", ")
        )))
    }
}

/// One that it makes.
fn own_topic(arguments: &mut Arguments) -> Result<Topic, Failure> {
    arguments.read(TOPIC, |name| Topic::new(name).ok())
}

/// One that it reads.
fn topic(arguments: &mut Arguments) -> Result<Topic, Failure> {
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
