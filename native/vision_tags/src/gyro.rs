//! The thread that follows the inertial unit, so that no sample is lost while the detector works.

use crate::complaint::Complaints;
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

/// What is known of the motion, filled by a thread of its own.
#[derive(Default)]
pub struct Gyro {
    motion: Arc<Mutex<Motion>>,
    thread: Option<JoinHandle<()>>,
}

impl Gyro {
    /// Starts to follow a topic, which need not exist yet, until the stop is requested.
    pub fn follow(topic: &Topic, stop: &Stop, log: Log) -> io::Result<Gyro> {
        let motion = Arc::default();
        let follower = Follower {
            topic: topic.clone(),
            motion: Arc::clone(&motion),
            stop: stop.clone(),
            log,
            complaints: Complaints::default(),
        };
        let builder = thread::Builder::new().name("imu".into());
        let thread = builder.spawn(move || follower.run())?;
        Ok(Gyro {
            motion,
            thread: Some(thread),
        })
    }

    /// The angular speed at a moment of `CLOCK_MONOTONIC_RAW`, rad/s, if samples near it say so.
    pub fn angular_speed_at(&self, time_ns: u64) -> Option<f64> {
        lock(&self.motion).angular_speed_at(time_ns)
    }

    /// Waits, after the stop was requested, until the topic is let go.
    pub fn join(self) {
        if let Some(thread) = self.thread {
            let _ = thread.join();
        }
    }
}

fn lock(motion: &Mutex<Motion>) -> MutexGuard<'_, Motion> {
    motion.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Follower {
    topic: Topic,
    motion: Arc<Mutex<Motion>>,
    stop: Stop,
    log: Log,
    complaints: Complaints,
}

impl Follower {
    /// Trouble with the ring is no reason to stop looking for tags: it is tried again.
    fn run(mut self) {
        let Some(mut imu) = self.open() else { return };
        let waker = imu.waker();
        self.stop.on_request(move || waker.wake());
        let mut message = Vec::new();
        while !self.stop.requested() {
            match imu.read_timeout(&mut message, Duration::from_secs(1)) {
                Ok(Read::Message(meta)) => self.take(&message, meta),
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
        self.complain(error);
        self.stop.wait_until(Instant::now() + PAUSE_AFTER_ERROR);
    }

    fn take(&mut self, message: &[u8], meta: Meta) {
        match Imu::decode(message) {
            Ok(imu) => {
                let offset_ns = clock::realtime_offset_ns();
                let time_ns = sample_time_ns(imu.stamp.unix_ns(), meta.timestamp_ns, offset_ns);
                lock(&self.motion).push(time_ns, imu.angular_velocity);
            }
            Err(error) => self.complain(&error),
        }
    }

    fn complain(&mut self, error: &dyn std::error::Error) {
        let what = format!("ring topic {:?}: {error}", self.topic.name());
        if let Some(line) = self.complaints.add(Instant::now(), what) {
            self.log.line(line);
        }
    }
}
