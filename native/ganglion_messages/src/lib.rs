//! What the messages on Ganglion's rings look like, byte by byte.
//!
//! | module | encoding's name on the ring | what it is |
//! |---|---|---|
//! | [`frame`] | [`frame::ENCODING`] | a camera frame: 44 bytes of header, then the pixels |
//! | [`imu`] | [`imu::ENCODING`] | one sample of an inertial unit, as ROS 2 writes it |
//! | [`tags`] | [`tags::ENCODING`] | the AprilTags seen in one frame, as ROS 2 writes it, and our tail |
//!
//! The last two are CDR, the encoding of ROS 2 and DDS; [`cdr`] reads and writes it.
//!
//! Everything here is a pure function of its input. Decoding takes whatever a peer has written: bytes that are not a message
//! give a small error that names the cause, never a panic, and no length that was read is believed before it was compared
//! with the bytes that are there.
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
