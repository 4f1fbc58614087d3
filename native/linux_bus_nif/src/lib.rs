//! I2C and GPIO of a Linux machine for the BEAM: terms in, system calls, terms out.
//!
//! Errors are the kernel's numbers, which `BB.Bus.Linux.Error` names. Calls that may block run on
//! the dirty I/O schedulers. An open bus lives as long as its handle, open lines at most as long
//! as the process that opened them.

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
