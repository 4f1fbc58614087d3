//! Tests of nodes as whole programs.

use crate::toolchain::{CPP_PEER, TestTopic};

fn ends_well_on(signal: libc::c_int) {
    let topic = TestTopic::new();
    let Some(mut node) = CPP_PEER.start(["node", topic.name(), "0"]) else {
        return;
    };
    node.expect("running");
    node.signal(signal);
    node.expect("joined 1");
    assert!(node.end().success());
    assert!(!topic.0.path().exists(), "its publisher closed the topic");
}

#[test]
fn sigterm_ends_a_node_with_its_threads_joined_and_its_topics_closed() {
    ends_well_on(libc::SIGTERM);
}

#[test]
fn sigint_ends_a_node_with_its_threads_joined_and_its_topics_closed() {
    ends_well_on(libc::SIGINT);
}
