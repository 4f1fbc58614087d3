//! Where the pictures come from.

use crate::options::Picture;
use crate::photographs::{self, Photograph};
use crate::scene::Scene;
use program::Failure;
use std::fmt;

/// A source of grey pictures.
pub enum Source {
    /// The rendered scene.
    Scene {
        /// What is rendered.
        scene: Box<Scene>,
        /// Frames a second of its time.
        rate_hz: f64,
        /// The last picture.
        pixels: Vec<u8>,
    },
    /// Photographs, round and round.
    Photographs(Vec<Photograph>),
}

impl Source {
    /// Prepares the pictures; photographs are all read here.
    pub fn open(picture: &Picture, rate_hz: f64) -> Result<Source, Failure> {
        match picture {
            Picture::Scene { width, height } => Ok(Source::Scene {
                scene: Box::new(Scene::new(*width, *height)),
                rate_hz,
                pixels: vec![0; *width as usize * *height as usize],
            }),
            Picture::Photographs(folder) => photographs::read_folder(folder)
                .map(Source::Photographs)
                .map_err(|error| Failure::Runtime(error.to_string())),
        }
    }

    /// Bytes of the largest picture.
    pub fn largest(&self) -> usize {
        match self {
            Source::Scene { pixels, .. } => pixels.len(),
            Source::Photographs(all) => all.iter().map(|one| one.pixels.len()).max().unwrap_or(0),
        }
    }

    /// Picture number `number`: width, height and pixels.
    pub fn take(&mut self, number: u64) -> (u32, u32, &[u8]) {
        match self {
            Source::Scene {
                scene,
                rate_hz,
                pixels,
            } => {
                scene.render(number, number as f64 / *rate_hz, pixels);
                (scene.width(), scene.height(), pixels)
            }
            Source::Photographs(all) => {
                let one = &all[(number % all.len() as u64) as usize];
                (one.width, one.height, &one.pixels)
            }
        }
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Source::Scene { scene, .. } => {
                write!(f, "a scene of {}x{} pixels", scene.width(), scene.height())
            }
            Source::Photographs(all) if all.len() == 1 => f.write_str("1 photograph"),
            Source::Photographs(all) => write!(f, "{} photographs", all.len()),
        }
    }
}
