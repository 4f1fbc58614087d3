//! Eyes for AprilTags.

pub mod eye;
