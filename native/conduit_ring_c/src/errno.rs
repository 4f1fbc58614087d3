//! Error numbers of C's errno.h on Linux. A test compares them with the header.

use std::ffi::c_int;

pub(crate) const EAGAIN: c_int = 11;
pub(crate) const EALREADY: c_int = 114;
pub(crate) const EBUSY: c_int = 16;
pub(crate) const ECANCELED: c_int = 125;
pub(crate) const EEXIST: c_int = 17;
pub(crate) const EINVAL: c_int = 22;
pub(crate) const EIO: c_int = 5;
pub(crate) const EMFILE: c_int = 24;
pub(crate) const EMSGSIZE: c_int = 90;
pub(crate) const ENOBUFS: c_int = 105;
pub(crate) const ENOENT: c_int = 2;
pub(crate) const ENOTRECOVERABLE: c_int = 131;
pub(crate) const EPERM: c_int = 1;
pub(crate) const EPROTO: c_int = 71;
pub(crate) const ESHUTDOWN: c_int = 108;
pub(crate) const ESTALE: c_int = 116;
pub(crate) const ETIMEDOUT: c_int = 110;
pub(crate) const EUSERS: c_int = 87;

#[cfg(any(target_arch = "mips", target_arch = "mips64", target_arch = "sparc64"))]
compile_error!("expected the error numbers of most Linux targets; errno.h has other ones here");
