//! The ring as C and C++ programs use it: compiled here, run as processes of their own.
//!
//! Without a compiler these tests do nothing and say so on standard error.

mod abi;
mod cases;
mod exchange;
mod install;
mod node;
mod toolchain;
