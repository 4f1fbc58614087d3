//! Opening device files, and saying what they are not.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;

use nix::fcntl::OFlag;
use nix::sys::stat::major;

use crate::errno::{Errno, Result};

/// The kernel's number for all adapters of i2c-dev.
const I2C_MAJOR: u64 = 89;

/// Opens a device file for reading and writing. A file that is no device, whatever it is, is not
/// waited for.
pub fn open(path: &Path) -> Result<File> {
    let flags = OFlag::O_NONBLOCK | OFlag::O_NOCTTY;
    Ok(OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags.bits())
        .open(path)?)
}

/// Refuses what is no I2C adapter before it is asked anything: another device may understand the
/// question as an order.
pub fn check_i2c(file: &File) -> Result<()> {
    let found = file.metadata()?;
    if found.file_type().is_char_device() && major(found.rdev()) == I2C_MAJOR {
        Ok(())
    } else {
        Err(Errno::NOTTY)
    }
}
