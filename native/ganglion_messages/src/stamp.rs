//! Time as ROS 2 represents it: seconds and nanoseconds since 1970.

use crate::cdr::{CdrError, Reader, Writer};

const NS_PER_S: i64 = 1_000_000_000;

/// A point in wall time (`CLOCK_REALTIME`), as in `builtin_interfaces/msg/Time`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stamp {
    /// Seconds since 1970-01-01 UTC, rounded down.
    pub sec: i32,
    /// Nanoseconds after `sec`, below 10⁹ in a valid message.
    pub nanosec: u32,
}

impl Stamp {
    /// Converts a wall time in nanoseconds. A time outside ROS's range becomes the nearest one
    /// within it.
    ///
    /// ```
    /// use ganglion_messages::stamp::Stamp;
    /// assert_eq!(Stamp::from_unix_ns(1_500_000_000), Stamp { sec: 1, nanosec: 500_000_000 });
    /// assert_eq!(Stamp::from_unix_ns(-1), Stamp { sec: -1, nanosec: 999_999_999 });
    /// ```
    pub fn from_unix_ns(unix_ns: i64) -> Stamp {
        let clamped = unix_ns.clamp(
            i64::from(i32::MIN) * NS_PER_S,
            i64::from(i32::MAX) * NS_PER_S + NS_PER_S - 1,
        );
        Stamp {
            sec: clamped.div_euclid(NS_PER_S) as i32,
            nanosec: clamped.rem_euclid(NS_PER_S) as u32,
        }
    }

    /// Returns the wall time in nanoseconds.
    pub fn unix_ns(self) -> i64 {
        i64::from(self.sec) * NS_PER_S + i64::from(self.nanosec)
    }

    pub(crate) fn write(self, writer: &mut Writer) {
        writer.i32(self.sec);
        writer.u32(self.nanosec);
    }

    pub(crate) fn read(reader: &mut Reader<'_>) -> Result<Stamp, CdrError> {
        Ok(Stamp {
            sec: reader.i32()?,
            nanosec: reader.u32()?,
        })
    }
}
