//! An I2C adapter, through the ioctls of the kernel's i2c-dev.

use std::fs::File;
use std::os::fd::AsRawFd;
use std::path::Path;

use nix::libc::{c_int, c_ulong};

use crate::device;
use crate::errno::{Errno, Result};

/// The longest message that the kernel accepts.
const LONGEST: usize = 8192;
/// The flag of a message that reads from the device (I2C_M_RD).
const READ: u16 = 1;

/// The bits `I2C_FUNC_…` of linux/i2c.h.
pub type Functions = c_ulong;

/// `struct i2c_msg` of linux/i2c.h.
#[repr(C)]
struct Message {
    address: u16,
    flags: u16,
    len: u16,
    bytes: *mut u8,
}

/// `struct i2c_rdwr_ioctl_data` of linux/i2c-dev.h.
#[repr(C)]
pub struct Transfer {
    messages: *mut Message,
    count: u32,
}

nix::ioctl_write_int_bad!(i2c_timeout, 0x0702);
nix::ioctl_read_bad!(i2c_funcs, 0x0705, c_ulong);
nix::ioctl_readwrite_bad!(i2c_rdwr, 0x0707, Transfer);

/// An open adapter.
pub struct Adapter(File);

impl Adapter {
    /// Opens `/dev/i2c-…`.
    pub fn open(path: &Path) -> Result<Self> {
        let file = device::open(path)?;
        device::check_i2c(&file)?;
        Ok(Self(file))
    }

    /// Returns the functions that the adapter supports.
    pub fn functions(&self) -> Result<Functions> {
        let mut functions: Functions = 0;
        // SAFETY: the kernel writes one unsigned long, and there is room for it.
        unsafe { i2c_funcs(self.0.as_raw_fd(), &raw mut functions) }?;
        Ok(functions)
    }

    /// Sets the timeout of a transfer, in steps of 10 ms. It applies to all users of the adapter.
    pub fn set_timeout(&self, steps: i32) -> Result<()> {
        // SAFETY: the argument is a number.
        unsafe { i2c_timeout(self.0.as_raw_fd(), steps as c_int) }?;
        Ok(())
    }

    /// Writes, then reads, as one transfer. Either part may be absent.
    pub fn transfer(
        &self,
        address: u16,
        write: Option<&[u8]>,
        read: Option<&mut [u8]>,
    ) -> Result<()> {
        // The kernel only reads the bytes of a message that writes to the device.
        let write = write.map(|bytes| (0, bytes.as_ptr().cast_mut(), bytes.len()));
        let read = read.map(|bytes| (READ, bytes.as_mut_ptr(), bytes.len()));
        let mut messages = Vec::with_capacity(2);
        for (flags, bytes, len) in write.into_iter().chain(read) {
            messages.push(Message {
                address,
                flags,
                len: length(len)?,
                bytes,
            });
        }
        let mut transfer = Transfer {
            messages: messages.as_mut_ptr(),
            count: messages.len() as u32,
        };
        // SAFETY: the messages and their bytes are borrowed for longer than this call, each has
        // the length that its message states, and the buffer to read into is borrowed mutably.
        unsafe { i2c_rdwr(self.0.as_raw_fd(), &raw mut transfer) }?;
        Ok(())
    }
}

fn length(len: usize) -> Result<u16> {
    u16::try_from(len)
        .ok()
        .filter(|_| len <= LONGEST)
        .ok_or(Errno::INVAL)
}
