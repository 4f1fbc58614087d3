//! The pictures that the camera shows.

use crate::options::Picture;
use crate::photographs::{self, Photograph};
use crate::scene::Scene;
use program::Failure;
use std::fmt;

/// A sequence of grey pictures.
pub enum Pictures {
    /// The rendered scene.
    Scene {
        /// The scene.
        scene: Box<Scene>,
        /// Frames per second of the scene's time.
        rate_hz: f64,
        /// Buffer for the last picture.
        pixels: Vec<u8>,
    },
    /// Photographs, in a loop.
    Photographs(Vec<Photograph>),
}

impl Pictures {
    /// Prepares the pictures. Reads all photographs.
    ///
    /// # Errors
    /// [`Failure::Runtime`] when a photograph cannot be read.
    pub fn open(picture: &Picture, rate_hz: f64) -> Result<Pictures, Failure> {
        match picture {
            Picture::Scene { width, height } => Ok(Pictures::Scene {
                scene: Box::new(Scene::new(*width, *height)),
                rate_hz,
                pixels: vec![0; *width as usize * *height as usize],
            }),
            Picture::Photographs(folder) => photographs::read_folder(folder)
                .map(Pictures::Photographs)
                .map_err(|error| Failure::Runtime(error.to_string())),
        }
    }

    /// Returns the size of the largest picture in bytes.
    pub fn largest(&self) -> usize {
        match self {
            Pictures::Scene { pixels, .. } => pixels.len(),
            Pictures::Photographs(all) => {
                all.iter().map(|one| one.pixels.len()).max().unwrap_or(0)
            }
        }
    }

    /// Returns width, height and pixels of picture number `number`.
    pub fn take(&mut self, number: u64) -> (u32, u32, &[u8]) {
        match self {
            Pictures::Scene {
                scene,
                rate_hz,
                pixels,
            } => {
                scene.render(number, number as f64 / *rate_hz, pixels);
                (scene.width(), scene.height(), pixels)
            }
            Pictures::Photographs(all) => {
                let one = &all[(number % all.len() as u64) as usize];
                (one.width, one.height, &one.pixels)
            }
        }
    }
}

impl fmt::Display for Pictures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Pictures::Scene { scene, .. } => {
                write!(f, "a scene of {}x{} pixels", scene.width(), scene.height())
            }
            Pictures::Photographs(all) if all.len() == 1 => f.write_str("1 photograph"),
            Pictures::Photographs(all) => write!(f, "{} photographs", all.len()),
        }
    }
}
