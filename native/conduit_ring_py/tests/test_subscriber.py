import os
import threading

import pytest

from conduit_ring import (
    BadSegmentError,
    ClosedError,
    Message,
    NoReaderSlotError,
    NoTopicError,
    Publisher,
    PublisherEvent,
    Subscriber,
    now_ns,
)
from conftest import LIMIT


def publish(publisher, numbers):
    for n in numbers:
        publisher.publish(str(n).encode())


def read_all(subscriber):
    messages = []
    while (message := subscriber.try_read()) is not None:
        messages.append(int(bytes(message)))
    return messages


def test_a_subscriber_waits_for_a_topic_that_does_not_exist_yet(topic):
    with Subscriber(topic) as subscriber:
        assert not subscriber.publisher_up
        assert subscriber.try_read() is None
        thread = threading.Thread(
            target=lambda: publishers.append(Publisher(topic)) or publishers[0].publish(b"first")
        )
        publishers = []
        thread.start()
        message = subscriber.recv(timeout=LIMIT)
        thread.join()
        assert (bytes(message), message.sequence, message.lost) == (b"first", 0, 0)
        assert subscriber.publisher_up
        publishers[0].close()


def test_a_message_has_the_time_of_its_publishing(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        before = now_ns()
        publisher.publish(b"x")
        after = now_ns()
        assert before <= subscriber.recv(timeout=0).timestamp_ns <= after


@pytest.mark.parametrize(
    "start, expected",
    [
        ("new", [5]),
        ("latest", [4, 5]),
        (("history", 3), [2, 3, 4, 5]),
        (("history", 0), [5]),
        (("history", 100), [0, 1, 2, 3, 4, 5]),
        (["history", 1], None),
    ],
)
def test_the_start_is_new_latest_or_history(topic, start, expected):
    with Publisher(topic) as publisher:
        publish(publisher, range(5))
        if expected is None:
            with pytest.raises(ValueError):
                Subscriber(topic, start=start)
            return
        with Subscriber(topic, start=start) as subscriber:
            publish(publisher, [5])
            assert read_all(subscriber) == expected


@pytest.mark.parametrize(
    "start", ["old", ("history",), ("history", -1), ("history", "3"), ("latest", 1), 3, b"new"]
)
def test_a_wrong_start_is_refused(topic, start):
    with pytest.raises(ValueError, match='expected "new", "latest"'):
        Subscriber(topic, start=start)


def test_a_wrong_policy_is_refused(topic):
    with pytest.raises(ValueError, match='expected "all" or "latest", got: "some"'):
        Subscriber(topic, policy="some")
    with pytest.raises(TypeError):
        Subscriber(topic, policy=3)


def test_the_policy_latest_gives_the_newest_and_counts_the_skipped(topic):
    with Publisher(topic) as publisher, Subscriber(topic, policy="latest") as subscriber:
        publish(publisher, range(5))
        message = subscriber.recv(timeout=0)
        assert (bytes(message), message.sequence, message.lost) == (b"4", 4, 4)
        assert subscriber.try_read() is None


def test_a_publisher_that_laps_is_seen_in_what_was_lost(topic):
    with Publisher(topic, slot_count=4) as publisher, Subscriber(topic) as subscriber:
        publish(publisher, range(3))
        assert subscriber.recv(timeout=0).lost == 0
        publish(publisher, range(3, 11))
        messages = [subscriber.recv(timeout=0) for _ in range(4)]
        assert [int(bytes(message)) for message in messages] == [7, 8, 9, 10]
        assert [message.lost for message in messages] == [6, 0, 0, 0]
        assert (subscriber.delivered, subscriber.lost) == (5, 6)
        assert "5 delivered, 6 lost" in repr(subscriber)


def test_when_the_time_is_up_it_says_so(topic):
    with Publisher(topic), Subscriber(topic) as subscriber:
        for timeout in [0, 0.05]:
            enter = subscriber.lease(timeout=timeout).__enter__
            for wait in [subscriber.recv, subscriber.next_event, enter]:
                with pytest.raises(TimeoutError, match=topic):
                    wait(timeout) if "__enter__" not in wait.__name__ else wait()


@pytest.mark.parametrize("timeout", [-1, -0.001, float("nan")])
def test_a_wrong_timeout_is_refused(topic, timeout):
    with Subscriber(topic) as subscriber:
        for wait in [subscriber.recv, subscriber.next_event, subscriber.lease]:
            with pytest.raises(ValueError, match="expected seconds from 0"):
                wait(timeout)


def test_a_very_long_timeout_waits(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        for timeout in [1e300, float("inf")]:
            publisher.publish(b"x")
            assert subscriber.recv(timeout=timeout)


def test_iteration_gives_messages_until_it_is_closed(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        publish(publisher, range(3))
        seen = []
        for message in subscriber:
            seen.append(bytes(message))
            if len(seen) == 3:
                subscriber.close()
        assert seen == [b"0", b"1", b"2"]


def test_events_tell_of_the_publisher_between_the_messages(topic):
    with Subscriber(topic) as subscriber:
        publisher = Publisher(topic)
        assert subscriber.next_event(timeout=LIMIT) is PublisherEvent.UP
        publisher.publish(b"last words")
        publisher.close()
        message = subscriber.next_event(timeout=LIMIT)
        assert isinstance(message, Message) and bytes(message) == b"last words"
        assert subscriber.next_event(timeout=LIMIT) is PublisherEvent.DOWN
        assert not subscriber.publisher_up

        with Publisher(topic, slot_count=4) as publisher:
            publisher.publish(b"again")
            seen = []
            for event in subscriber.events():
                seen.append(event)
                if isinstance(event, Message):
                    break
        assert seen[0] is PublisherEvent.UP and bytes(seen[1]) == b"again"


def test_recv_passes_over_what_the_publisher_does(topic):
    with Subscriber(topic) as subscriber:
        for n in range(3):
            with Publisher(topic) as publisher:
                publish(publisher, [n])
                assert bytes(subscriber.recv(timeout=LIMIT)) == str(n).encode()


@pytest.mark.parametrize("wait", ["recv", "next_event", "__next__", "lease", "events"])
def test_closing_ends_a_wait_in_another_thread(topic, wait):
    subscriber = Subscriber(topic)
    ended = []

    def read():
        try:
            if wait == "lease":
                with subscriber.lease():
                    pass
            elif wait == "events":
                ended.append(list(subscriber.events()))
            else:
                getattr(subscriber, wait)()
        except (ClosedError, StopIteration) as error:
            ended.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    wait_until_read(subscriber)
    subscriber.close()
    thread.join(LIMIT)
    assert not thread.is_alive()
    assert len(ended) == 1


def wait_until_read(subscriber):
    while True:
        try:
            subscriber.try_read()
        except RuntimeError:
            return


def test_only_one_thread_reads_at_a_time(topic):
    subscriber = Subscriber(topic)

    def read():
        with pytest.raises(ClosedError):
            subscriber.recv()

    thread = threading.Thread(target=read)
    thread.start()
    wait_until_read(subscriber)
    with pytest.raises(RuntimeError, match="being read already"):
        subscriber.recv(timeout=0)
    subscriber.close()
    thread.join(LIMIT)


def test_other_threads_run_while_one_waits(topic):
    subscriber, answers = Subscriber(topic), Subscriber(topic)
    with Publisher(topic) as publisher, subscriber, answers:
        messages = []
        thread = threading.Thread(target=lambda: messages.append(subscriber.recv(timeout=LIMIT)))
        thread.start()
        wait_until_read(subscriber)
        publisher.publish(b"go")
        thread.join(LIMIT)
        assert bytes(messages[0]) == bytes(answers.recv(timeout=0)) == b"go"


def test_a_closed_subscriber_says_that_it_is(topic):
    subscriber = Subscriber(topic)
    assert not subscriber.closed
    subscriber.close()
    subscriber.close()
    assert subscriber.closed
    assert "closed" in repr(subscriber)
    enter = subscriber.lease().__enter__
    for use in [subscriber.recv, subscriber.try_read, subscriber.next_event, enter]:
        with pytest.raises(ClosedError, match="subscriber is closed"):
            use()
    assert list(subscriber) == []
    assert list(subscriber.events()) == []


def test_a_17th_subscriber_is_refused_until_another_leaves(topic):
    with Publisher(topic):
        subscribers = [Subscriber(topic) for _ in range(16)]
        with pytest.raises(NoReaderSlotError, match="16 reader slots"):
            Subscriber(topic)
        subscribers.pop().close()
        subscribers.append(Subscriber(topic))
        for subscriber in subscribers:
            subscriber.close()


def test_a_subscriber_tells_about_its_topic(topic):
    with Subscriber(topic) as subscriber:
        assert subscriber.topic == topic
        with pytest.raises(NoTopicError):
            subscriber.info()
        with Publisher(topic):
            assert subscriber.info().state == "live"


def test_a_guarded_subscriber_survives_a_file_that_is_cut_off(topic):
    with Publisher(topic) as publisher, Subscriber(topic, guard="always") as guarded:
        with Subscriber(topic, guard="never") as trusting:
            assert len(publisher.info().readers) == 1, "a guarded one does not show"
            publisher.publish(b"one")
            assert trusting.recv(timeout=0).data == guarded.recv(timeout=0).data == b"one"
        publisher.publish(b"two")
        with guarded.lease(timeout=0) as lease:
            assert (lease.data, lease.holds_slot) == (b"two", False)
        publisher.publish(b"gone")
        # Keeps the header and removes the slots.
        os.truncate(f"/dev/shm/conduit_{topic}", 1216)
        with pytest.raises(BadSegmentError, match=f"conduit_{topic}"):
            guarded.try_read()


def test_a_wrong_guard_is_refused(topic):
    with pytest.raises(ValueError, match='"auto", "always" or "never", got: "maybe"'):
        Subscriber(topic, guard="maybe")
