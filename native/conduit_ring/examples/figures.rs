//! Measures publishing and reading beside a bare memcpy, in turns, so that all of them run under
//! the same load.
//!
//! ```text
//! cargo run --release -p conduit_ring --example figures
//! ```

use std::hint::black_box;
use std::thread;
use std::time::{Duration, Instant};

use conduit_ring::{
    Geometry, Policy, Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions, Topic,
    clock,
};

const LARGE: usize = 2_000_000;
const SMALL: usize = 48;
const ROUNDS: usize = 200;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let topic = Topic::new(&format!("figures-{}", std::process::id()))?;
    let geometry = Geometry::depth(4, LARGE as u32)?;
    let mut publisher = Publisher::open(
        &topic,
        &PublisherOptions {
            geometry,
            ..Default::default()
        },
    )?;
    let options = SubscriberOptions {
        policy: Policy::Latest,
        ..Default::default()
    };
    let mut subscriber = Subscriber::open(&topic, &options)?;
    let message: Vec<u8> = (0..=255).cycle().take(LARGE).collect();
    let mut target = vec![0_u8; 4 * LARGE];
    let mut buffer = Vec::with_capacity(LARGE);

    let mut copy = Vec::new();
    let mut publish = Vec::new();
    let mut read = Vec::new();
    for round in 0..ROUNDS {
        let target = &mut target[round % 4 * LARGE..][..LARGE];
        copy.push(time(1, || {
            black_box(&mut *target).copy_from_slice(black_box(&message))
        }));
        publish.push(time(1, || _ = publisher.publish(black_box(&message))));
        read.push(time(1, || {
            drop(black_box(subscriber.try_read(&mut buffer)))
        }));
        assert_eq!(buffer, message);
    }
    let base = report("memcpy 2 MB", copy, None);
    report("publish 2 MB", publish, Some(base));
    report("read 2 MB", read, Some(base));

    let mut clock_read = Vec::new();
    let mut publish = Vec::new();
    let mut both = Vec::new();
    for _ in 0..ROUNDS {
        clock_read.push(time(10_000, || _ = black_box(clock::now_ns())));
        publish.push(time(10_000, || {
            _ = publisher.publish(black_box(&message[..SMALL]))
        }));
        subscriber.try_read(&mut buffer)?;
        both.push(time(10_000, || {
            let _ = publisher.publish(black_box(&message[..SMALL]));
            let read = subscriber.try_read(&mut buffer);
            assert!(matches!(read, Ok(Read::Message(meta)) if meta.lost == 0));
        }));
        assert_eq!(buffer, message[..SMALL]);
    }
    report("read the clock", clock_read, None);
    report("publish 48 B", publish, None);
    report("publish and read 48 B", both, None);
    assert_eq!(publisher.info().wake_count, 0);
    report(
        "wake a sleeper, 1 kHz",
        latencies(&mut publisher, subscriber),
        None,
    );
    Ok(())
}

/// Returns the times from the stamp of a message to its receipt by a thread that slept, at 1 kHz.
fn latencies(publisher: &mut Publisher, mut subscriber: Subscriber) -> Vec<f64> {
    const COUNT: u64 = 2000;
    let last = publisher.next_sequence() + COUNT - 1;
    let reader = thread::spawn(move || {
        let mut buffer = Vec::new();
        let mut latencies = Vec::new();
        while let Ok(Read::Message(meta)) = subscriber.read_timeout(&mut buffer, Duration::MAX) {
            latencies.push((clock::now_ns() - meta.timestamp_ns) as f64);
            assert_eq!(buffer, [7; SMALL]);
            if meta.sequence == last {
                break;
            }
        }
        latencies
    });
    for _ in 0..COUNT {
        thread::sleep(Duration::from_millis(1));
        assert!(publisher.publish(&[7; SMALL]).is_ok());
    }
    reader.join().expect("the reader checks what it receives")
}

/// Returns the nanoseconds per call.
fn time(count: u32, mut call: impl FnMut()) -> f64 {
    let start = Instant::now();
    (0..count).for_each(|_| call());
    start.elapsed().as_nanos() as f64 / f64::from(count)
}

/// Prints and returns the median.
fn report(what: &str, mut runs: Vec<f64>, base: Option<f64>) -> f64 {
    runs.sort_by(f64::total_cmp);
    let [p10, median, p99] = [10, 50, 99].map(|percent| runs[runs.len() * percent / 100]);
    let ratio = base.map_or(String::new(), |base| {
        format!("  {:.2} x memcpy", median / base)
    });
    println!("{what:<22} p10 {p10:>9.1}  p50 {median:>9.1}  p99 {p99:>9.1} ns{ratio}");
    median
}
