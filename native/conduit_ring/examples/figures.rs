//! Measures publishing and reading beside a bare memcpy: `cargo run --release --example figures`.

use std::hint::black_box;
use std::time::Instant;

use conduit_ring::{
    Geometry, Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions, Topic,
};

fn main() -> Result<(), conduit_ring::Error> {
    let topic = Topic::new(&format!("figures-{}", std::process::id()))?;
    let geometry = Geometry::depth(8, 2_100_000)?;
    let options = PublisherOptions {
        geometry,
        ..Default::default()
    };
    let mut publisher = Publisher::open(&topic, &options)?;
    let mut subscriber = Subscriber::open(&topic, &SubscriberOptions::default())?;
    let mut buffer = Vec::with_capacity(2_100_000);
    let message = vec![7_u8; 2_000_000];
    let mut target = vec![vec![1_u8; 2_100_000]; 8];
    for round in 0..3 {
        println!("round {round}");
        let mut n = 0;
        report("memcpy 2 MB", 200, || {
            n += 1;
            black_box(&mut target[n % 8][..2_000_000]).copy_from_slice(black_box(&message));
        });
        report("publish 2 MB", 200, || {
            publisher.publish(black_box(&message)).unwrap();
        });
        report("publish and read 2 MB", 200, || {
            publisher.publish(black_box(&message)).unwrap();
            while !matches!(subscriber.try_read(&mut buffer).unwrap(), Read::Message(_)) {}
        });
        report("publish 48 B", 1_000_000, || {
            publisher.publish(black_box(&message[..48])).unwrap();
        });
        report("publish and read 48 B", 1_000_000, || {
            publisher.publish(black_box(&message[..48])).unwrap();
            let _ = subscriber.try_read(&mut buffer).unwrap();
        });
        report("clock", 1_000_000, || {
            black_box(conduit_ring::clock::now_ns());
        });
    }
    Ok(())
}

/// Prints the median of 11 runs of `count` calls.
fn report(what: &str, count: u32, mut call: impl FnMut()) {
    let mut runs: Vec<f64> = (0..11)
        .map(|_| {
            let start = Instant::now();
            (0..count).for_each(|_| call());
            start.elapsed().as_nanos() as f64 / f64::from(count)
        })
        .collect();
    runs.sort_by(f64::total_cmp);
    println!("  {what:<24} {:>12.1} ns (best {:.1})", runs[5], runs[0]);
}
