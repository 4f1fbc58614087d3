//! The benchmark peer for iceoryx2. It loans, copies and sends; an event service wakes the
//! receiver.
//!
//! ```text
//! iceoryx2_peer publish --bytes N --rounds N --calls N
//! iceoryx2_peer send    --topic T --count N --rate HZ
//! iceoryx2_peer receive --topic T --count N
//! ```

use std::hint::black_box;
use std::time::Duration;

use comparison::{Arguments, Deadlines, SMALL, age_of, print_latencies, print_median, stamped};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::*;

type Ipc = ipc::Service;

/// Size of a subscriber's buffer in messages, equal to the ring's number of slots.
const DEPTH: usize = 256;

fn main() {
    set_log_level(LogLevel::Error);
    let (verb, arguments) = Arguments::of_process();
    match verb.as_str() {
        "publish" => publish(&arguments),
        "send" => send(&arguments),
        "receive" => receive(&arguments),
        other => panic!("unknown verb {other:?}; expected one of: publish, send, receive"),
    }
}

fn node() -> Node<Ipc> {
    NodeBuilder::new().create().expect("a node")
}

fn name(text: &str) -> ServiceName {
    text.try_into().expect("a service name")
}

fn publish(arguments: &Arguments) {
    let bytes: usize = arguments.get("--bytes");
    let node = node();
    let service = node
        .service_builder(&name(&format!("bench.publish.{}", std::process::id())))
        .publish_subscribe::<[u8]>()
        .create()
        .expect("a service");
    let publisher = service
        .publisher_builder()
        .initial_max_slice_len(bytes)
        .create()
        .expect("a publisher");
    let message = vec![7_u8; bytes];
    print_median(arguments.get("--rounds"), arguments.get("--calls"), || {
        send_copy(&publisher, black_box(&message))
    });
}

fn send_copy(publisher: &Publisher<Ipc, [u8], ()>, message: &[u8]) {
    let sample = publisher.loan_slice_uninit(message.len()).expect("a loan");
    sample.write_from_slice(message).send().expect("sent");
}

fn send(arguments: &Arguments) {
    let topic: String = arguments.get("--topic");
    let node = node();
    let data = node
        .service_builder(&name(&topic))
        .publish_subscribe::<[u8]>()
        .subscriber_max_buffer_size(DEPTH)
        .open_or_create()
        .expect("a service");
    let event = node
        .service_builder(&name(&topic))
        .event()
        .open_or_create()
        .expect("an event service");
    let publisher = data
        .publisher_builder()
        .initial_max_slice_len(SMALL)
        .create()
        .expect("a publisher");
    let notifier = event.notifier_builder().create().expect("a notifier");
    while event.dynamic_config().number_of_listeners() == 0
        || data.dynamic_config().number_of_subscribers() == 0
    {
        std::thread::sleep(Duration::from_millis(1));
    }
    std::thread::sleep(Duration::from_millis(100));
    let mut deadlines = Deadlines::new(arguments.get("--rate"));
    for number in 0..arguments.get("--count") {
        deadlines.wait();
        send_copy(&publisher, &stamped(number));
        notifier.notify().expect("notified");
    }
    std::thread::sleep(Duration::from_millis(200));
}

fn receive(arguments: &Arguments) {
    let topic: String = arguments.get("--topic");
    let node = node();
    let data = node
        .service_builder(&name(&topic))
        .publish_subscribe::<[u8]>()
        .subscriber_max_buffer_size(DEPTH)
        .open_or_create()
        .expect("a service");
    let event = node
        .service_builder(&name(&topic))
        .event()
        .open_or_create()
        .expect("an event service");
    let subscriber = data
        .subscriber_builder()
        .buffer_size(DEPTH)
        .create()
        .expect("a subscriber");
    let listener = event.listener_builder().create().expect("a listener");
    let count: usize = arguments.get("--count");
    let mut ages = Vec::with_capacity(count);
    while ages.len() < count {
        listener
            .timed_wait(|_| {}, Duration::from_secs(10))
            .expect("an event");
        while let Some(sample) = subscriber.receive().expect("a receive") {
            ages.push(age_of(sample.payload(), ages.len() as u64));
        }
    }
    print_latencies(ages);
}
