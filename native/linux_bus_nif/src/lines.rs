//! Open lines of a chip. Only one thread at a time has to do with them.

use std::fs::File;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use gpiocdev_uapi::v2::{self, LineEdgeEvent, LineRequest, LineValues, Name, Offsets};
use rustler::OwnedEnv;

use crate::device;
use crate::edges::{Levels, Listener};
use crate::errno::{Errno, Result};
use crate::settings::{Direction, Settings, Trigger, mask};
use crate::watcher::Watcher;

/// What the kernel calls whoever has the lines.
const CONSUMER: &[u8] = b"ganglion";
/// So many edges the kernel keeps for us, before it drops what comes.
const EDGES_KEPT: u32 = 256;
/// More the kernel never keeps: 16 a line, of 64 lines.
const MOST_EDGES_KEPT: usize = 1024;
/// So many edges are taken at once.
const EDGES_READ: usize = 16;

/// Lines that were opened together.
pub struct Lines {
    /// By which the watcher knows them.
    pub id: u64,
    /// The chip's name, by which the kernel knows it, and its lines.
    pub chip: String,
    pub offsets: Vec<u32>,
    held: Mutex<Option<Held>>,
    watcher: Arc<Watcher>,
}

struct Held {
    file: File,
    settings: Settings,
    /// What outputs were set to.
    levels: u64,
    listener: Option<Listener>,
}

/// Why lines were not written.
pub enum Unwritten {
    Input,
    Errno(Errno),
}

impl Lines {
    /// Asks the chip for lines.
    pub fn open(
        path: &Path,
        offsets: Vec<u32>,
        settings: Settings,
        levels: u64,
    ) -> Result<Arc<Self>> {
        let watcher = Watcher::started()?;
        let chip = device::open(path)?;
        let info = v2::get_chip_info(&chip)?;
        let request = LineRequest {
            offsets: Offsets::from_slice(&offsets),
            num_lines: offsets.len() as u32,
            consumer: Name::from_bytes(CONSUMER),
            config: settings.config(levels, offsets.len()),
            event_buffer_size: EDGES_KEPT,
            ..LineRequest::default()
        };
        let held = Held {
            file: v2::get_line(&chip, request)?,
            settings,
            levels,
            listener: None,
        };
        Ok(watcher.register(|id| Self {
            id,
            chip: info.name.as_os_str().to_string_lossy().into_owned(),
            offsets,
            held: Mutex::new(Some(held)),
            watcher: watcher.clone(),
        }))
    }

    /// The levels, a bit each.
    pub fn read(&self) -> Result<u64> {
        self.with(|held, lines| held.read(lines))
    }

    /// Sets the levels of outputs.
    pub fn write(&self, levels: u64) -> std::result::Result<(), Unwritten> {
        let written = self.with(|held, lines| {
            if held.settings.direction == Direction::Input {
                return Ok(false);
            }
            held.write(levels, lines).map(|()| true)
        });
        match written {
            Ok(true) => Ok(()),
            Ok(false) => Err(Unwritten::Input),
            Err(error) => Err(Unwritten::Errno(error)),
        }
    }

    /// Changes how the lines are set.
    pub fn set(&self, change: impl FnOnce(&mut Settings)) -> Result<()> {
        self.with(|held, lines| held.set(change, lines))
    }

    /// Tells somebody of edges, and nobody else any more.
    pub fn listen(&self, mut listener: Listener) -> Result<()> {
        self.with(|held, lines| {
            // As the kernel's, which cannot be asked when there are no more descriptors.
            if let Ok(levels) = held.read(lines) {
                listener.levels = Levels(levels);
            }
            let edges = listener.edges();
            held.set(|settings| settings.edges = edges, lines)?;
            held.forget_edges();
            if edges == Trigger::None {
                held.ignore(&self.watcher);
                return Ok(());
            }
            if held.listener.is_none() {
                self.watcher.watch(&held.file, self.id)?;
            }
            held.listener = Some(listener);
            Ok(())
        })
    }

    /// Tells of the edges that there are; called by the watcher alone. Who is gone, and a chip that
    /// is gone, is not listened to any more.
    pub fn pass_on(&self, message: &mut OwnedEnv) {
        let passed = self.with(|held, _lines| {
            let told = held.tell(&self.offsets, message);
            if told.is_err() {
                held.ignore(&self.watcher);
            }
            Ok(())
        });
        // Lines that were closed meanwhile have no edges.
        let _ = passed;
    }

    /// Gives the lines back; once more changes nothing.
    pub fn close(&self) {
        let mut held = self.lock();
        if let Some(mut held) = held.take() {
            held.ignore(&self.watcher);
        }
    }

    /// Whether they were given back, as far as that can be said without waiting.
    pub fn is_closed(&self) -> bool {
        self.held.try_lock().is_ok_and(|held| held.is_none())
    }

    fn with<T>(&self, action: impl FnOnce(&mut Held, usize) -> Result<T>) -> Result<T> {
        let mut held = self.lock();
        let held = held.as_mut().ok_or(Errno::BADF)?;
        action(held, self.offsets.len())
    }

    fn lock(&self) -> MutexGuard<'_, Option<Held>> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        self.watcher.forget(self.id);
    }
}

impl Held {
    fn read(&self, lines: usize) -> Result<u64> {
        let mut values = LineValues {
            bits: 0,
            mask: mask(lines),
        };
        v2::get_line_values(&self.file, &mut values)?;
        Ok(values.bits & values.mask)
    }

    fn write(&mut self, levels: u64, lines: usize) -> Result<()> {
        let mask = mask(lines);
        let bits = levels & mask;
        v2::set_line_values(&self.file, &LineValues { bits, mask })?;
        self.levels = bits;
        Ok(())
    }

    fn set(&mut self, change: impl FnOnce(&mut Settings), lines: usize) -> Result<()> {
        let mut settings = self.settings;
        change(&mut settings);
        v2::set_line_config(&self.file, settings.config(self.levels, lines))?;
        self.settings = settings;
        Ok(())
    }

    fn ignore(&mut self, watcher: &Watcher) {
        if self.listener.take().is_some() {
            watcher.ignore(&self.file);
        }
    }

    fn tell(&mut self, offsets: &[u32], message: &mut OwnedEnv) -> std::result::Result<(), ()> {
        let Some(listener) = &mut self.listener else {
            return Ok(());
        };
        for event in edges(&self.file).map_err(|_| ())? {
            let bit = offsets.iter().position(|offset| *offset == event.offset);
            if let Some(bit) = bit {
                listener.tell(message, bit, &event).map_err(|_| ())?;
            }
        }
        Ok(())
    }

    /// Edges from before somebody listened.
    fn forget_edges(&self) {
        let any = |_: &usize| edges(&self.file).is_ok_and(|edges| !edges.is_empty());
        let _ = (0..MOST_EDGES_KEPT / EDGES_READ).take_while(any).count();
    }
}

/// The edges that there are, at most [`EDGES_READ`] of them. Reading would wait where there is none.
fn edges(file: &File) -> Result<Vec<LineEdgeEvent>> {
    if !v2::has_event(file)? {
        return Ok(Vec::new());
    }
    let size = LineEdgeEvent::u64_size();
    let mut words = [0; EDGES_READ * size_of::<LineEdgeEvent>() / 8];
    let read = v2::read_event(file, &mut words)?;
    if read < size {
        return Err(Errno::NODEV);
    }
    words[..read]
        .chunks_exact(size)
        .map(|words| Ok(LineEdgeEvent::from_slice(words)?.clone()))
        .collect()
}
