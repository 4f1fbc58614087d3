"""Checksummed messages between Python and Rust, also across restarts of a publisher."""

import threading
import time

import checked
import pytest

from conduit_ring import Message, Publisher, PublisherEvent, Subscriber, info
from conftest import LIMIT

COUNT = 1000
"""No more than the ring holds, so that no subscriber falls behind."""


def read_all(subscriber, count=COUNT):
    for expected in range(count):
        message = subscriber.recv(timeout=LIMIT)
        assert (message.sequence, message.lost) == (expected, 0)
        assert checked.number(message.data) == expected


def test_rust_reads_what_python_publishes(rust_peer, topic):
    with Publisher(topic, depth=1024, max_message_size=checked.LONGEST) as publisher:
        peer = rust_peer("subscribe", topic, COUNT)
        peer.expect("ready")
        for n in range(COUNT):
            message = checked.message(n)
            assert publisher.publish(message[:16], message[16:]) == n
        peer.expect("whole")
        assert peer.end() == (0, "")


def test_python_reads_what_rust_publishes(rust_peer, topic):
    peer = rust_peer("publish", topic, COUNT)
    peer.expect("open")
    with Subscriber(topic) as subscriber, Subscriber(topic) as borrower:
        peer.go()
        read_all(subscriber)
        for expected in range(COUNT):
            with borrower.lease(timeout=LIMIT) as frame:
                assert frame.sequence == checked.number(frame.data) == expected
        assert peer.end() == (0, "")
        assert subscriber.next_event(timeout=LIMIT) is PublisherEvent.DOWN


PUBLISH = """
import sys
sys.path.insert(0, sys.argv[3])
import checked
from conduit_ring import Publisher

with Publisher(sys.argv[1], depth=1024, max_message_size=checked.LONGEST) as publisher:
    print("open", flush=True)
    sys.stdin.readline()
    for n in range(int(sys.argv[2])):
        assert publisher.publish(checked.message(n)) == n
    sys.stdin.read()
"""


def test_python_and_rust_read_what_another_python_publishes(python, rust_peer, topic, request):
    with Subscriber(topic) as subscriber:
        peer = rust_peer("subscribe", topic, COUNT)
        peer.expect("ready")
        other = python(PUBLISH, topic, COUNT, request.path.parent)
        other.expect("open")
        other.go()
        read_all(subscriber)
        peer.expect("whole")
        assert other.end() == (0, "")


def test_what_a_lapping_rust_publisher_overwrites_is_counted(rust_peer, topic):
    peer = rust_peer("burst", topic, 3000)
    peer.expect("open")
    with Subscriber(topic) as subscriber:
        for burst in range(1, 4):
            peer.go()
            peer.expect("published")
            message = subscriber.recv(timeout=0)
            assert (message.sequence, message.lost) == (burst * 3000 - 1024, 3000 - 1024)
            for expected in range(burst * 3000 - 1023, burst * 3000):
                message = subscriber.recv(timeout=0)
                assert (message.sequence, message.lost) == (expected, 0)
                assert checked.number(message.data) == expected
        assert (subscriber.delivered, subscriber.lost) == (3 * 1024, 3 * (3000 - 1024))


@pytest.mark.parametrize("borrow", [False, True], ids=["recv", "lease"])
def test_nothing_torn_is_read_while_a_rust_publisher_laps(rust_peer, topic, borrow):
    peer = rust_peer("flood", topic)
    peer.expect("open")
    with Subscriber(topic, start="latest") as subscriber:
        last = -1
        for _ in range(500):
            if borrow:
                with subscriber.lease(timeout=LIMIT) as message:
                    sequence, lost = message.sequence, message.lost
                    assert checked.number(message.data) == sequence
            else:
                message = subscriber.recv(timeout=LIMIT)
                sequence, lost = message.sequence, message.lost
                assert checked.number(message.data) == sequence
            assert last == -1 or sequence == last + 1 + lost
            last = sequence
        peer.kill()


def test_a_waiting_subscriber_continues_with_the_next_publisher_of_a_killed_one(rust_peer, topic):
    with Subscriber(topic) as subscriber:
        sequences = []
        for life in range(4):
            peer = rust_peer("flood", topic)
            peer.expect("open")
            for _ in range(50):
                message = subscriber.recv(timeout=LIMIT)
                assert checked.number(message.data) == message.sequence
                sequences.append((message.sequence, message.lost))
            peer.kill()
        for (before, _), (after, lost) in zip(sequences, sequences[1:]):
            assert after == before + 1 + lost
        assert info(topic).state == "dead"
        assert info(topic).epoch == 3


def test_a_waiting_subscriber_gets_events_of_its_publishers_death_and_restart(
    python, topic, request
):
    with Subscriber(topic) as subscriber:
        seen = []
        thread = threading.Thread(target=lambda: seen.extend(subscriber.events()))
        thread.start()
        first = python(PUBLISH, topic, 0, request.path.parent)
        first.expect("open")
        wait_for(lambda: seen == [PublisherEvent.UP])
        first.kill()
        wait_for(lambda: seen == [PublisherEvent.UP, PublisherEvent.DOWN])
        second = python(PUBLISH, topic, 0, request.path.parent)
        second.expect("open")
        wait_for(lambda: seen == [PublisherEvent.UP, PublisherEvent.DOWN, PublisherEvent.UP])
        second.kill()
        with Publisher(topic, depth=1024, max_message_size=checked.LONGEST) as publisher:
            publisher.publish(b"third")
            wait_for(lambda: any(isinstance(event, Message) for event in seen))
        subscriber.close()
        thread.join(LIMIT)
        assert [bytes(event) for event in seen if isinstance(event, Message)] == [b"third"]


def wait_for(condition):
    end = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.005)


SUBSCRIBE = """
import sys
from conduit_ring import Subscriber

with Subscriber(sys.argv[1]) as subscriber:
    print("ready", flush=True)
    for _ in subscriber:
        print("message", flush=True)
"""


def test_a_killed_subscribers_place_is_taken_back(python, topic):
    with Publisher(topic) as publisher:
        others = [Subscriber(topic) for _ in range(15)]
        for _ in range(3):
            victim = python(SUBSCRIBE, topic)
            victim.expect("ready")
            publisher.publish(b"x")
            victim.expect("message")
            victim.kill()
        with Subscriber(topic) as last:
            publisher.publish(b"y")
            assert bytes(last.recv(timeout=0)) == b"y"
        for other in others:
            other.close()
