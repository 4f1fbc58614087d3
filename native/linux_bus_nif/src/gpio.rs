//! GPIO lines as a resource, and information about chips.

use std::path::Path;
use std::sync::Arc;

use gpiocdev_uapi::v2::{self, Name};
use rustler::{
    Atom, Encoder, Env, LocalPid, Monitor, NifMap, NifResult, Resource, ResourceArc, Term,
};

use crate::device;
use crate::edges::{Form, Label, Levels, Listener};
use crate::errno::{self, Errno, Result};
use crate::lines::{Lines, WriteError};
use crate::settings::{Direction, Drive, Pull, Settings, Trigger};
use crate::watcher::{Watched, Watcher};

mod atoms {
    rustler::atoms! { pin_not_output }
}

/// Lines that close when the process that opened them dies, or when the last handle is garbage
/// collected.
pub struct Handle(Arc<Lines>);

#[rustler::resource_impl]
impl Resource for Handle {
    const IMPLEMENTS_DOWN: bool = true;

    fn down<'a>(&'a self, _env: Env<'a>, _pid: LocalPid, _monitor: Monitor) {
        self.abandon();
    }
}

impl Drop for Handle {
    fn drop(&mut self) {
        self.abandon();
    }
}

impl Handle {
    fn abandon(&self) {
        if self.0.is_closed() {
            return;
        }
        if let Ok(watcher) = Watcher::started() {
            watcher.abandon(self.0.clone());
        }
    }
}

/// Returns a chip as `{name, label, names of its lines}`.
#[rustler::nif(schedule = "DirtyIo")]
fn gpio_chip<'a>(env: Env<'a>, path: &str) -> Term<'a> {
    errno::result(env, chip(Path::new(path)))
}

fn chip(path: &Path) -> Result<(String, String, Vec<String>)> {
    let chip = device::open(path)?;
    let info = v2::get_chip_info(&chip)?;
    let lines = (0..info.num_lines)
        .map(|offset| Ok(text(&v2::get_line_info(&chip, offset)?.name)))
        .collect::<Result<_>>()?;
    Ok((text(&info.name), text(&info.label), lines))
}

/// The settings and the consumer of a line.
#[derive(NifMap)]
struct Status {
    consumer: String,
    direction: Direction,
    pull_mode: Pull,
    drive_mode: Drive,
}

#[rustler::nif(schedule = "DirtyIo")]
fn gpio_status<'a>(env: Env<'a>, path: &str, offset: i64) -> Term<'a> {
    errno::result(env, status(Path::new(path), offset))
}

fn status(path: &Path, offset: i64) -> Result<Status> {
    let chip = device::open(path)?;
    let info = v2::get_line_info(&chip, number(offset)?)?;
    let settings = Settings::from(info.flags);
    Ok(Status {
        consumer: text(&info.consumer),
        direction: settings.direction,
        pull_mode: settings.pull,
        drive_mode: settings.drive,
    })
}

/// Returns `{:ok, {lines, chip}}` with the kernel's name of the chip.
#[rustler::nif(schedule = "DirtyIo")]
fn gpio_open<'a>(
    env: Env<'a>,
    path: &str,
    offsets: Vec<i64>,
    direction: Direction,
    levels: u64,
    modes: (Pull, Drive),
) -> Term<'a> {
    let settings = Settings {
        direction,
        pull: modes.0,
        drive: modes.1,
        edges: Trigger::None,
    };
    let opened = open(Path::new(path), &offsets, settings, levels).map(|lines| {
        let chip = lines.chip.clone();
        (owned(env, lines), chip)
    });
    errno::result(env, opened)
}

fn open(path: &Path, offsets: &[i64], settings: Settings, levels: u64) -> Result<Arc<Lines>> {
    let offsets = offsets.iter().map(|offset| number(*offset));
    Lines::open(path, offsets.collect::<Result<_>>()?, settings, levels)
}

fn owned(env: Env, lines: Arc<Lines>) -> ResourceArc<Handle> {
    let handle = ResourceArc::new(Handle(lines));
    if handle.monitor(Some(env), &env.pid()).is_none() {
        handle.abandon();
    }
    handle
}

#[rustler::nif(schedule = "DirtyIo")]
fn gpio_close(handle: ResourceArc<Handle>) -> Atom {
    handle.0.close();
    rustler::types::atom::ok()
}

/// Closes all lines of this VM that include the given one.
#[rustler::nif(schedule = "DirtyIo")]
fn gpio_force_close<'a>(env: Env<'a>, path: &str, offset: i64) -> Term<'a> {
    errno::done(env, force_close(Path::new(path), offset))
}

fn force_close(path: &Path, offset: i64) -> Result<()> {
    let info = v2::get_chip_info(&device::open(path)?)?;
    let offset = number(offset)?;
    for lines in Watcher::started()?.including(&text(&info.name), offset) {
        lines.close();
    }
    Ok(())
}

#[rustler::nif(schedule = "DirtyIo")]
fn gpio_read(env: Env, handle: ResourceArc<Handle>) -> Term {
    errno::result(env, handle.0.read())
}

#[rustler::nif(schedule = "DirtyIo")]
fn gpio_write(env: Env, handle: ResourceArc<Handle>, levels: u64) -> Term {
    match handle.0.write(levels) {
        Ok(()) => errno::done(env, Ok(())),
        Err(WriteError::Errno(error)) => errno::done(env, Err(error)),
        Err(WriteError::Input) => {
            (rustler::types::atom::error(), atoms::pin_not_output()).encode(env)
        }
    }
}

#[rustler::nif(schedule = "DirtyIo")]
fn gpio_set_direction(env: Env, handle: ResourceArc<Handle>, direction: Direction) -> Term {
    errno::done(env, handle.0.set(|settings| settings.direction = direction))
}

#[rustler::nif(schedule = "DirtyIo")]
fn gpio_set_pull(env: Env, handle: ResourceArc<Handle>, pull: Pull) -> Term {
    errno::done(env, handle.0.set(|settings| settings.pull = pull))
}

#[rustler::nif(schedule = "DirtyIo")]
fn gpio_set_drive(env: Env, handle: ResourceArc<Handle>, drive: Drive) -> Term {
    errno::done(env, handle.0.set(|settings| settings.drive = drive))
}

/// Sends edges to the receiver from now on, with the label in each message.
#[rustler::nif(schedule = "DirtyIo")]
fn gpio_listen<'a>(
    env: Env<'a>,
    handle: ResourceArc<Handle>,
    form: Form,
    trigger: Trigger,
    receiver: LocalPid,
    label: Term<'a>,
) -> NifResult<Term<'a>> {
    let listener = Listener {
        receiver,
        trigger,
        form,
        label: Label::new(label),
        levels: Levels(0),
    };
    Ok(errno::done(env, handle.0.listen(listener)))
}

fn number(offset: i64) -> Result<u32> {
    u32::try_from(offset).map_err(|_| Errno::INVAL)
}

fn text(name: &Name) -> String {
    name.as_os_str().to_string_lossy().into_owned()
}
