//! I2C and GPIO of a Linux machine as the BEAM sees them: terms in, system calls, terms out.
//!
//! Errors are the kernel's numbers; `BB.Bus.Linux.Error` gives them their names. Whatever may take
//! long runs on the schedulers for I/O. An open bus lives as long as its handle, open lines at most
//! as long as the process that opened them.

mod adapter;
mod device;
mod edges;
mod errno;
mod gpio;
mod i2c;
mod lines;
mod settings;
mod watcher;

use rustler::{Env, Term};

rustler::init!("Elixir.BB.Bus.Linux.Native", load = load);

fn load(env: Env, _info: Term) -> bool {
    env.register::<i2c::Bus>().is_ok() && env.register::<gpio::Handle>().is_ok()
}
