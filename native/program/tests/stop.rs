//! A stop request reaches all waiting threads.

use program::stop::Stop;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

#[test]
fn a_request_ends_a_wait() {
    let stop = Stop::new();
    let waiting = stop.clone();
    let thread =
        thread::spawn(move || waiting.wait_until(Instant::now() + Duration::from_secs(60)));
    stop.request();
    assert!(thread.join().unwrap());
}

#[test]
fn a_deadline_ends_a_wait() {
    assert!(!Stop::new().wait_until(Instant::now()));
}

#[test]
fn a_request_calls_the_registered_wakers_also_those_that_register_late() {
    let stop = Stop::new();
    let (sender, receiver) = mpsc::channel();
    let late = sender.clone();
    stop.on_request(move || sender.send("early").unwrap());
    stop.request();
    assert_eq!(receiver.recv(), Ok("early"));
    stop.on_request(move || late.send("late").unwrap());
    assert_eq!(receiver.recv(), Ok("late"));
    assert!(stop.requested());
}

#[test]
fn a_signal_requests_the_stop() {
    let stop = Stop::of_process(false).unwrap();
    signal_hook::low_level::raise(signal_hook::consts::SIGTERM).unwrap();
    assert!(stop.wait_until(Instant::now() + Duration::from_secs(60)));
}
