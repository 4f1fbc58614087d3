//! A camera that is a program: it publishes grey frames on a ring topic, at a set rate.
//!
//! Its frames are either pictures of a rendered [`scene`], in which AprilTags move and of which the truth is known, or
//! [`photographs`] from a folder, one after the other and round again. The library is the program; `main` only calls
//! [`camera_main`].

//pub mod options;
pub mod pace;
pub mod photographs;
pub mod scene;
pub mod tag;
