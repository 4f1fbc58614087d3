//! An I2C bus as a resource.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use rustler::{Atom, Binary, Env, NewBinary, NifResult, Resource, ResourceArc, Term};

use crate::adapter::{Adapter, Functions};
use crate::errno::{self, Errno, Result};

/// An adapter that closes by `i2c_close` or when the last handle is garbage collected. A transfer
/// in progress completes first, without delaying the caller.
pub struct Bus(Mutex<Option<Arc<Adapter>>>);

#[rustler::resource_impl]
impl Resource for Bus {}

impl Bus {
    fn adapter(&self) -> Result<Arc<Adapter>> {
        let held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        held.clone().ok_or(Errno::BADF)
    }
}

/// Returns `{:ok, {bus, functions}}`. Steps are of 10 ms; without them the timeout stays as it
/// is.
#[rustler::nif(schedule = "DirtyIo")]
fn i2c_open<'a>(env: Env<'a>, path: &str, timeout_steps: Option<i32>) -> Term<'a> {
    errno::result(env, open(Path::new(path), timeout_steps))
}

fn open(path: &Path, timeout_steps: Option<i32>) -> Result<(ResourceArc<Bus>, Functions)> {
    let adapter = Adapter::open(path)?;
    let functions = adapter.functions()?;
    if let Some(steps) = timeout_steps {
        adapter.set_timeout(steps)?;
    }
    let bus = Bus(Mutex::new(Some(Arc::new(adapter))));
    Ok((ResourceArc::new(bus), functions))
}

#[rustler::nif(schedule = "DirtyIo")]
fn i2c_write<'a>(
    env: Env<'a>,
    bus: ResourceArc<Bus>,
    address: u16,
    data: Term<'a>,
) -> NifResult<Term<'a>> {
    let data = Binary::from_iolist(data)?;
    let written = bus
        .adapter()
        .and_then(|adapter| adapter.transfer(address, Some(&data), None));
    Ok(errno::done(env, written))
}

/// Writes `data`, if any, then reads.
#[rustler::nif(schedule = "DirtyIo")]
fn i2c_read<'a>(
    env: Env<'a>,
    bus: ResourceArc<Bus>,
    address: u16,
    data: Option<Term<'a>>,
    count: usize,
) -> NifResult<Term<'a>> {
    let data = data.map(Binary::from_iolist).transpose()?;
    Ok(errno::result(
        env,
        read(env, &bus, address, data.as_deref(), count),
    ))
}

fn read<'a>(
    env: Env<'a>,
    bus: &Bus,
    address: u16,
    data: Option<&[u8]>,
    count: usize,
) -> Result<Binary<'a>> {
    let adapter = bus.adapter()?;
    // A longer read is refused, so it needs no memory.
    let mut answer = NewBinary::new(env, count.min(usize::from(u16::MAX)));
    adapter.transfer(address, data, Some(answer.as_mut_slice()))?;
    Ok(answer.into())
}

#[rustler::nif(schedule = "DirtyIo")]
fn i2c_close(bus: ResourceArc<Bus>) -> Atom {
    let adapter = bus.0.lock().unwrap_or_else(PoisonError::into_inner).take();
    drop(adapter);
    rustler::types::atom::ok()
}
