//! Tests of the ring with C and C++ programs, which are compiled here and run as processes.
//!
//! Without a compiler these tests print a line on stderr and pass.

mod abi;
mod cases;
mod exchange;
mod install;
mod node;
mod toolchain;
