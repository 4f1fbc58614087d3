//! Open lines of a chip. A lock admits one thread at a time.

use std::fs::File;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use gpiocdev_uapi::v2::{self, LineEdgeEvent, LineRequest, LineValues, Name, Offsets};
use rustler::OwnedEnv;

use crate::device;
use crate::edges::{Levels, Listener};
use crate::errno::{Errno, Result};
use crate::settings::{Direction, Settings, Trigger, mask};
use crate::watcher::{Watched, Watcher};

/// The consumer's name that the kernel shows.
const CONSUMER: &[u8] = b"ganglion";
/// The number of edges that the kernel buffers before it drops new ones.
const BUFFERED_EDGES: u32 = 256;
/// The kernel's maximum: 16 edges for each of 64 lines.
const MOST_BUFFERED_EDGES: usize = 1024;
/// The number of edges read at once.
const EDGES_PER_READ: usize = 16;

/// Lines that were opened together.
pub struct Lines {
    /// The watcher's number for these lines.
    id: u64,
    /// The kernel's name of the chip.
    pub chip: String,
    offsets: Vec<u32>,
    request: Mutex<Option<Request>>,
    watcher: Arc<Watcher>,
}

/// The kernel's request for the lines while they are open.
struct Request {
    file: File,
    settings: Settings,
    /// The last levels written to outputs.
    levels: u64,
    listener: Option<Listener>,
}

/// The reason why levels were not written.
pub enum WriteError {
    Input,
    Errno(Errno),
}

impl Lines {
    /// Requests lines from the chip.
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
            event_buffer_size: BUFFERED_EDGES,
            ..LineRequest::default()
        };
        let request = Request {
            file: v2::get_line(&chip, request)?,
            settings,
            levels,
            listener: None,
        };
        Ok(watcher.register(|id| Self {
            id,
            chip: info.name.as_os_str().to_string_lossy().into_owned(),
            offsets,
            request: Mutex::new(Some(request)),
            watcher: watcher.clone(),
        }))
    }

    /// Returns the levels, one bit each.
    pub fn read(&self) -> Result<u64> {
        self.with_request(|request, lines| request.read(lines))
    }

    /// Sets the levels of outputs.
    pub fn write(&self, levels: u64) -> std::result::Result<(), WriteError> {
        let written = self.with_request(|request, lines| {
            if request.settings.direction == Direction::Input {
                return Ok(false);
            }
            request.write(levels, lines).map(|()| true)
        });
        match written {
            Ok(true) => Ok(()),
            Ok(false) => Err(WriteError::Input),
            Err(error) => Err(WriteError::Errno(error)),
        }
    }

    /// Changes the settings of the lines.
    pub fn set(&self, change: impl FnOnce(&mut Settings)) -> Result<()> {
        self.with_request(|request, lines| request.set(change, lines))
    }

    /// Sends edges to a listener, in place of the previous one.
    pub fn listen(&self, mut listener: Listener) -> Result<()> {
        self.with_request(|request, lines| {
            // Starts from the kernel's levels, or from 0 if they cannot be read.
            if let Ok(levels) = request.read(lines) {
                listener.levels = Levels(levels);
            }
            let edges = listener.edges();
            request.set(|settings| settings.edges = edges, lines)?;
            request.discard_edges();
            if edges == Trigger::None {
                request.stop_listening(&self.watcher);
                return Ok(());
            }
            if request.listener.is_none() {
                self.watcher.watch(&request.file, self.id)?;
            }
            request.listener = Some(listener);
            Ok(())
        })
    }

    /// Returns whether the lines are closed, as far as that is known without waiting.
    pub fn is_closed(&self) -> bool {
        self.request
            .try_lock()
            .is_ok_and(|request| request.is_none())
    }

    fn with_request<T>(
        &self,
        action: impl FnOnce(&mut Request, usize) -> Result<T>,
    ) -> Result<T> {
        let mut request = self.lock();
        let request = request.as_mut().ok_or(Errno::BADF)?;
        action(request, self.offsets.len())
    }

    fn lock(&self) -> MutexGuard<'_, Option<Request>> {
        self.request.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Watched for Lines {
    fn includes(&self, chip: &str, offset: u32) -> bool {
        self.chip == chip && self.offsets.contains(&offset)
    }

    fn deliver_edges(&self, message: &mut OwnedEnv) {
        let delivered = self.with_request(|request, _lines| {
            if request.send_edges(&self.offsets, message).is_err() {
                request.stop_listening(&self.watcher);
            }
            Ok(())
        });
        // Lines that were closed meanwhile have no edges.
        let _ = delivered;
    }

    fn close(&self) {
        let mut request = self.lock();
        if let Some(mut request) = request.take() {
            request.stop_listening(&self.watcher);
        }
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        self.watcher.unregister(self.id);
    }
}

impl Request {
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

    fn stop_listening(&mut self, watcher: &Watcher) {
        if self.listener.take().is_some() {
            watcher.unwatch(&self.file);
        }
    }

    fn send_edges(
        &mut self,
        offsets: &[u32],
        message: &mut OwnedEnv,
    ) -> std::result::Result<(), ()> {
        let Some(listener) = &mut self.listener else {
            return Ok(());
        };
        for event in read_edges(&self.file).map_err(|_| ())? {
            let bit = offsets.iter().position(|offset| *offset == event.offset);
            if let Some(bit) = bit {
                listener.send(message, bit, &event).map_err(|_| ())?;
            }
        }
        Ok(())
    }

    /// Discards the edges from before the listener started.
    fn discard_edges(&self) {
        let any = |_: &usize| read_edges(&self.file).is_ok_and(|edges| !edges.is_empty());
        let _ = (0..MOST_BUFFERED_EDGES / EDGES_PER_READ)
            .take_while(any)
            .count();
    }
}

/// Returns the buffered edges, at most [`EDGES_PER_READ`]. Returns none at once if there are
/// none, because reading would block.
fn read_edges(file: &File) -> Result<Vec<LineEdgeEvent>> {
    if !v2::has_event(file)? {
        return Ok(Vec::new());
    }
    let size = LineEdgeEvent::u64_size();
    let mut words = [0; EDGES_PER_READ * size_of::<LineEdgeEvent>() / 8];
    let read = v2::read_event(file, &mut words)?;
    if read < size {
        return Err(Errno::NODEV);
    }
    words[..read]
        .chunks_exact(size)
        .map(|words| Ok(LineEdgeEvent::from_slice(words)?.clone()))
        .collect()
}
