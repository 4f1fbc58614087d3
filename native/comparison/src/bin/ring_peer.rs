//! The benchmark peer for the ring.
//!
//! ```text
//! ring_peer memcpy  --bytes N --rounds N --calls N     copy into shared memory
//! ring_peer publish --bytes N --rounds N --calls N     publish without readers
//! ring_peer send    --topic T --count N --rate HZ      send stamped messages at a rate
//! ring_peer receive --topic T --count N                measure the age of each message
//! ring_peer port    --count N --rate HZ                write stamped messages to standard output
//! ```

use std::hint::black_box;
use std::io::Write;
use std::os::fd::AsRawFd;
use std::time::Duration;

use comparison::{Arguments, Deadlines, age_of, print_latencies, print_median, stamped};
use conduit_ring::{
    Geometry, Publisher, PublisherOptions, Read, Subscriber, SubscriberOptions, Topic,
};

const SLOTS: usize = 4;
/// Number of slots with which a receiver may pause for a quarter of a second without a loss.
const DEPTH: u32 = 256;

fn main() {
    let (verb, arguments) = Arguments::of_process();
    match verb.as_str() {
        "memcpy" => memcpy(&arguments),
        "publish" => publish(&arguments),
        "send" => send(&arguments),
        "receive" => receive(&arguments),
        "port" => port(&arguments),
        other => {
            panic!(
                "unknown verb {other:?}; expected one of: memcpy, publish, send, receive, port"
            )
        }
    }
}

/// Copies to four places in turn, like a ring of four slots.
fn memcpy(arguments: &Arguments) {
    let bytes: usize = arguments.get("--bytes");
    let target = SharedMemory::new(SLOTS * bytes);
    let source = vec![7_u8; bytes];
    let mut turn = 0;
    print_median(arguments.get("--rounds"), arguments.get("--calls"), || {
        let place = target.at(turn % SLOTS * bytes);
        // SAFETY: the place has room for `bytes` bytes, and no other code uses the memory.
        unsafe { std::ptr::copy_nonoverlapping(black_box(&source).as_ptr(), place, bytes) };
        turn += 1;
    });
}

struct SharedMemory(*mut u8);

impl SharedMemory {
    fn new(len: usize) -> Self {
        let path = format!("/dev/shm/comparison-{}", std::process::id());
        let file = std::fs::File::create_new(&path).expect("a file in /dev/shm");
        std::fs::remove_file(&path).expect("its name removed");
        file.set_len(len as u64).expect("its length");
        drop(file.metadata());
        let file = reopen(&file);
        // SAFETY: creates a new mapping, and the file is as long as the mapping.
        let start = unsafe {
            let protection = libc::PROT_READ | libc::PROT_WRITE;
            let flags = libc::MAP_SHARED | libc::MAP_POPULATE;
            libc::mmap(
                std::ptr::null_mut(),
                len,
                protection,
                flags,
                file.as_raw_fd(),
                0,
            )
        };
        assert_ne!(
            start,
            libc::MAP_FAILED,
            "{}",
            std::io::Error::last_os_error()
        );
        Self(start.cast())
    }

    fn at(&self, offset: usize) -> *mut u8 {
        self.0.wrapping_add(offset)
    }
}

/// Opens the file for reading and writing, which a writable mapping requires.
fn reopen(file: &std::fs::File) -> std::fs::File {
    let path = format!("/proc/self/fd/{}", file.as_raw_fd());
    std::fs::File::options()
        .read(true)
        .write(true)
        .open(path)
        .expect("the file again")
}

fn publish(arguments: &Arguments) {
    let bytes: usize = arguments.get("--bytes");
    let topic = Topic::new(&format!("bench.publish.{}", std::process::id())).expect("a topic");
    let mut publisher = open(&topic, bytes);
    let message = vec![7_u8; bytes];
    print_median(arguments.get("--rounds"), arguments.get("--calls"), || {
        publisher.publish(black_box(&message)).expect("published");
    });
}

fn open(topic: &Topic, bytes: usize) -> Publisher {
    let geometry = Geometry::depth(SLOTS as u32, bytes as u32).expect("slots");
    Publisher::open(
        topic,
        &PublisherOptions {
            geometry,
            ..Default::default()
        },
    )
    .expect("a publisher")
}

fn send(arguments: &Arguments) {
    let topic = Topic::new(&arguments.get::<String>("--topic")).expect("a topic");
    let geometry = Geometry::depth(DEPTH, 4000).expect("slots");
    let mut publisher = Publisher::open(
        &topic,
        &PublisherOptions {
            geometry,
            ..Default::default()
        },
    )
    .expect("a publisher");
    while publisher.info().readers.is_empty() {
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut deadlines = Deadlines::new(arguments.get("--rate"));
    for number in 0..arguments.get("--count") {
        deadlines.wait();
        publisher.publish(&stamped(number)).expect("published");
    }
    // Lets the reader get the last message before the topic ends.
    std::thread::sleep(Duration::from_millis(200));
}

fn receive(arguments: &Arguments) {
    let topic = Topic::new(&arguments.get::<String>("--topic")).expect("a topic");
    let mut subscriber =
        Subscriber::open(&topic, &SubscriberOptions::default()).expect("a subscriber");
    let count: usize = arguments.get("--count");
    let (mut ages, mut buffer) = (Vec::with_capacity(count), Vec::new());
    while ages.len() < count {
        match subscriber
            .read_timeout(&mut buffer, Duration::from_secs(10))
            .expect("a read")
        {
            Read::Message(meta) => {
                assert_eq!(meta.lost, 0, "nothing is lost at this rate");
                ages.push(age_of(&buffer, ages.len() as u64));
            }
            Read::Nothing => panic!("no message within ten seconds"),
            Read::PublisherUp | Read::PublisherDown => {}
        }
    }
    print_latencies(ages);
}

fn port(arguments: &Arguments) {
    let mut deadlines = Deadlines::new(arguments.get("--rate"));
    let mut output = std::io::stdout();
    for number in 0..arguments.get("--count") {
        deadlines.wait();
        output.write_all(&stamped(number)).expect("written");
        output.flush().expect("flushed");
    }
    // The standard input ends when the port closes.
    let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
}
