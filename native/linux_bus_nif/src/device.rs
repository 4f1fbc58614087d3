//! Opening of device files and checking of their kind.

use std::fs::{File, OpenOptions};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;

use nix::fcntl::OFlag;
use nix::sys::stat::major;

use crate::errno::{Errno, Result};

/// The kernel's major number of i2c-dev adapters.
const I2C_MAJOR: u64 = 89;

/// Opens a device file for reading and writing. Never waits, even if the file is not a device.
pub fn open(path: &Path) -> Result<File> {
    let flags = OFlag::O_NONBLOCK | OFlag::O_NOCTTY;
    Ok(OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags.bits())
        .open(path)?)
}

/// Checks that a file is an I2C adapter before any ioctl: another device may understand the same
/// number as a command.
pub fn check_i2c(file: &File) -> Result<()> {
    let found = file.metadata()?;
    if found.file_type().is_char_device() && major(found.rdev()) == I2C_MAJOR {
        Ok(())
    } else {
        Err(Errno::NOTTY)
    }
}
