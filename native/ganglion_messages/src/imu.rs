//! `sensor_msgs/msg/Imu`: one sample of an inertial measurement unit.

use crate::cdr::{CdrError, Reader, Writer};
use crate::stamp::Stamp;

/// The encoding's name. The ring's content tag is its hash.
pub const ENCODING: &str = "sensor_msgs/msg/Imu";

/// A sample in SI units. A covariance of zeros means not known.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Imu {
    /// Wall time of the sample.
    pub stamp: Stamp,
    /// The name of the sensor or of its coordinate frame.
    pub frame_id: String,
    /// A quaternion, x y z w; not known when the first element of its covariance is -1.
    pub orientation: [f64; 4],
    /// Row-major, rad².
    pub orientation_covariance: [f64; 9],
    /// x y z, rad/s.
    pub angular_velocity: [f64; 3],
    /// Row-major, (rad/s)².
    pub angular_velocity_covariance: [f64; 9],
    /// x y z, m/s².
    pub linear_acceleration: [f64; 3],
    /// Row-major, (m/s²)².
    pub linear_acceleration_covariance: [f64; 9],
}

impl Imu {
    /// Encodes the message into `buffer` and replaces the buffer's contents.
    pub fn encode_into(&self, buffer: &mut Vec<u8>) {
        let mut writer = Writer::new(buffer);
        self.stamp.write(&mut writer);
        writer.string(&self.frame_id);
        writer.f64s(&self.orientation);
        writer.f64s(&self.orientation_covariance);
        writer.f64s(&self.angular_velocity);
        writer.f64s(&self.angular_velocity_covariance);
        writer.f64s(&self.linear_acceleration);
        writer.f64s(&self.linear_acceleration_covariance);
    }

    /// Encodes the message.
    pub fn encode(&self) -> Vec<u8> {
        let mut buffer = Vec::new();
        self.encode_into(&mut buffer);
        buffer
    }

    /// Decodes a message. Bytes after it are ignored.
    ///
    /// # Errors
    /// A [`CdrError`] when the bytes are not this message.
    pub fn decode(message: &[u8]) -> Result<Imu, CdrError> {
        let mut reader = Reader::new(message)?;
        Ok(Imu {
            stamp: Stamp::read(&mut reader)?,
            frame_id: reader.string()?.to_owned(),
            orientation: reader.f64s()?,
            orientation_covariance: reader.f64s()?,
            angular_velocity: reader.f64s()?,
            angular_velocity_covariance: reader.f64s()?,
            linear_acceleration: reader.f64s()?,
            linear_acceleration_covariance: reader.f64s()?,
        })
    }

    /// Returns the norm of the angular velocity, rad/s.
    pub fn angular_speed(&self) -> f64 {
        let [x, y, z] = self.angular_velocity;
        (x * x + y * y + z * z).sqrt()
    }
}
