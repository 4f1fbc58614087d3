//! The thread that reads the samples of the inertial measurement unit, so that none is lost while
//! the detector works.

use crate::log_limit::LogLimit;
use crate::motion::{Motion, sample_time_ns};
use conduit_ring::{Meta, Read, Subscriber, SubscriberOptions, Topic, clock};
use ganglion_messages::imu::Imu;
use program::Log;
use program::stop::Stop;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

const PAUSE_AFTER_ERROR: Duration = Duration::from_millis(500);

/// The motion as its own thread reads it from the ring.
#[derive(Default)]
pub struct ImuFollower {
    motion: Arc<Mutex<Motion>>,
    thread: Option<JoinHandle<()>>,
}

impl ImuFollower {
    /// Starts to read a topic, which need not exist yet, until the stop is requested.
    ///
    /// # Errors
    /// The operating system's error when no thread can be started.
    pub fn start(topic: &Topic, stop: &Stop, log: Log) -> io::Result<ImuFollower> {
        let motion = Arc::default();
        let reader = Reader {
            topic: topic.clone(),
            motion: Arc::clone(&motion),
            stop: stop.clone(),
            log,
            errors: LogLimit::default(),
        };
        let builder = thread::Builder::new().name("imu".into());
        let thread = builder.spawn(move || reader.run())?;
        Ok(ImuFollower {
            motion,
            thread: Some(thread),
        })
    }

    /// Returns the angular speed at a time of `CLOCK_MONOTONIC_RAW` in rad/s, or `None` without
    /// samples near it.
    pub fn angular_speed_at(&self, time_ns: u64) -> Option<f64> {
        lock(&self.motion).angular_speed_at(time_ns)
    }

    /// Waits until the thread has released the topic. Call it after the stop was requested.
    pub fn join(self) {
        if let Some(thread) = self.thread {
            let _ = thread.join();
        }
    }
}

fn lock(motion: &Mutex<Motion>) -> MutexGuard<'_, Motion> {
    motion.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Reader {
    topic: Topic,
    motion: Arc<Mutex<Motion>>,
    stop: Stop,
    log: Log,
    errors: LogLimit,
}

impl Reader {
    /// Reads until the stop is requested. Retries after errors of the ring, because the detector
    /// works without an IMU too.
    fn run(mut self) {
        let Some(mut imu) = self.open() else { return };
        let waker = imu.waker();
        self.stop.on_request(move || waker.wake());
        let mut message = Vec::new();
        while !self.stop.requested() {
            match imu.read_timeout(&mut message, Duration::from_secs(1)) {
                Ok(Read::Message(meta)) => self.handle(&message, meta),
                Ok(_) => {}
                Err(error) => self.pause_after(&error),
            }
        }
    }

    fn open(&mut self) -> Option<Subscriber> {
        while !self.stop.requested() {
            match Subscriber::open(&self.topic, &SubscriberOptions::default()) {
                Ok(imu) => return Some(imu),
                Err(error) => self.pause_after(&error),
            }
        }
        None
    }

    fn pause_after(&mut self, error: &conduit_ring::Error) {
        self.log_error(error);
        self.stop.wait_until(Instant::now() + PAUSE_AFTER_ERROR);
    }

    fn handle(&mut self, message: &[u8], meta: Meta) {
        match Imu::decode(message) {
            Ok(imu) => {
                let offset_ns = clock::realtime_offset_ns();
                let time_ns = sample_time_ns(imu.stamp.unix_ns(), meta.timestamp_ns, offset_ns);
                lock(&self.motion).push(time_ns, imu.angular_velocity);
            }
            Err(error) => self.log_error(&error),
        }
    }

    fn log_error(&mut self, error: &dyn std::error::Error) {
        let event = format!("ring topic {:?}: {error}", self.topic.name());
        if let Some(line) = self.errors.count(Instant::now(), event) {
            self.log.line(line);
        }
    }
}
