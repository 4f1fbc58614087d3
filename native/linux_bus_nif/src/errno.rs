//! The kernel's error numbers, and the results that carry them to Elixir.

use rustler::{Encoder, Env, Term};

/// The number of a system error, as in errno.h.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Errno(pub i32);

impl Errno {
    /// A handle that was closed.
    pub const BADF: Self = Self(9);
    /// An input/output error without a number of its own.
    pub const IO: Self = Self(5);
    /// No such device.
    pub const NODEV: Self = Self(19);
    /// An argument that the kernel would refuse.
    pub const INVAL: Self = Self(22);
    /// The file is another kind of device.
    pub const NOTTY: Self = Self(25);
}

/// The result of a system call.
pub type Result<T> = std::result::Result<T, Errno>;

impl From<std::io::Error> for Errno {
    fn from(error: std::io::Error) -> Self {
        error.raw_os_error().map_or(Self::IO, Self)
    }
}

impl From<nix::errno::Errno> for Errno {
    fn from(error: nix::errno::Errno) -> Self {
        Self(error as i32)
    }
}

impl From<gpiocdev_uapi::Error> for Errno {
    fn from(error: gpiocdev_uapi::Error) -> Self {
        match error {
            gpiocdev_uapi::Error::Os(errno) => Self(errno.0),
            gpiocdev_uapi::Error::UnderRead(_) => Self::IO,
        }
    }
}

/// Encodes `{:ok, value}` or `{:error, errno}`.
pub fn result<T: Encoder>(env: Env<'_>, result: Result<T>) -> Term<'_> {
    match result {
        Ok(value) => (rustler::types::atom::ok(), value).encode(env),
        Err(error) => failure(env, error),
    }
}

/// Encodes `:ok` or `{:error, errno}`.
pub fn done(env: Env<'_>, result: Result<()>) -> Term<'_> {
    match result {
        Ok(()) => rustler::types::atom::ok().to_term(env),
        Err(error) => failure(env, error),
    }
}

fn failure(env: Env<'_>, error: Errno) -> Term<'_> {
    (rustler::types::atom::error(), error.0).encode(env)
}
