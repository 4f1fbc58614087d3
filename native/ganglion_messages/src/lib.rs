//! Encodings of the messages on Ganglion's rings.
//!
//! Programs that publish or read frames, IMU samples or tag detections use this crate, so that
//! all of them agree on the bytes.
//!
//! | module | name of the encoding on the ring | message |
//! |---|---|---|
//! | [`frame`] | [`frame::ENCODING`] | a camera frame: 44 bytes of header, then the pixels |
//! | [`imu`] | [`imu::ENCODING`] | one sample of an inertial measurement unit, as in ROS 2 |
//! | [`tags`] | [`tags::ENCODING`] | the AprilTags in one frame, as in ROS 2, with a tail of ours |
//!
//! The last two are CDR, the encoding of ROS 2 and DDS, which [`cdr`] reads and writes.
//!
//! All functions are pure. Decoding accepts any bytes: bytes that are not a message give a small
//! error that names the cause, never a panic. Each length in a message is compared with the size
//! of the message before it is used.
//!
//! ```
//! use ganglion_messages::frame::{Frame, FrameHeader};
//!
//! let header = FrameHeader::grey(4, 2, 1_000, 7);
//! let message = [&header.encode()[..], &[10, 20, 30, 40, 50, 60, 70, 80]].concat();
//!
//! let frame = Frame::decode(&message)?;
//! assert_eq!(frame.header.frame_id, 7);
//! assert_eq!(frame.rows().last(), Some(&[50, 60, 70, 80][..]));
//! # Ok::<(), ganglion_messages::frame::FrameError>(())
//! ```

pub mod cdr;
pub mod frame;
pub mod imu;
pub mod stamp;
pub mod tags;
