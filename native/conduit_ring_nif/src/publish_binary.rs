//! The NIF that publishes a small binary, registered by hand. `#[rustler::nif]` would collect the
//! arguments in a vector and count a reference to the publisher in each call, which costs half as
//! much as publishing.

use std::panic::{self, AssertUnwindSafe};
use std::slice;

use rustler::codegen_runtime::{NIF_ENV, NIF_TERM, NifReturned, c_int, inventory};
use rustler::types::atom;
use rustler::{Binary, Env, Nif, Term};

use crate::publication::{self, PublisherResource};

inventory::submit!(Nif {
    name: c"publish_binary".as_ptr(),
    arity: 2,
    flags: 0,
    raw_func: publish_binary,
});

/// `publish_binary(publisher, data)`: returns `:ok` or the atom of an error. After `:busy` the
/// caller tries again.
unsafe extern "C" fn publish_binary(
    env: NIF_ENV,
    argc: c_int,
    argv: *const NIF_TERM,
) -> NIF_TERM {
    let lifetime = ();
    // SAFETY: the VM passes the environment of this call, which outlives `lifetime`.
    let call = unsafe { Env::new(&lifetime, env) };
    // SAFETY: the VM passes `argc` terms.
    let arguments = unsafe { slice::from_raw_parts(argv, argc as usize) };
    // SAFETY: the terms belong to the environment of this call.
    let argument = |n: usize| unsafe { Term::new(call, arguments[n]) };
    let (publisher, data) = (argument(0), argument(1));
    let result = panic::catch_unwind(AssertUnwindSafe(|| publish(publisher, data)));
    let returned = result.unwrap_or_else(|_| NifReturned::Raise(atom::nif_panicked().as_c_arg()));
    // SAFETY: the returned or raised term is an atom.
    unsafe { returned.apply(call) }
}

fn publish(publisher: Term, data: Term) -> NifReturned {
    let publisher = publisher.try_get_resource::<PublisherResource>();
    let (Some(publisher), Ok(data)) = (publisher, Binary::from_term(data)) else {
        return NifReturned::BadArg;
    };
    let result = publication::publish(publisher, |publisher| publisher.publish(&data));
    NifReturned::Term(result.as_c_arg())
}
