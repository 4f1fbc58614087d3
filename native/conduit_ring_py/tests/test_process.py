"""The package in a process: signals, forks, threads and memory."""

import gc
import os
import pathlib
import signal
import threading
import time

import pytest

from conduit_ring import NameLostError, Publisher, PublisherAliveError, Subscriber, info
from conftest import LIMIT

WAIT = """
import sys
from conduit_ring import Subscriber

subscriber = Subscriber(sys.argv[1])
try:
    print("ready", flush=True)
    WAIT
except KeyboardInterrupt:
    print("interrupted", flush=True)
    subscriber.close()
"""


def wait_until_asleep(pid):
    """Wait until the process sleeps in a system call, which after its last line is the wait."""
    end = time.monotonic() + LIMIT
    while True:
        with open(f"/proc/{pid}/stat") as stat:
            if stat.read().rpartition(")")[2].split()[0] == "S":
                return
        assert time.monotonic() < end, "it does not wait"


@pytest.mark.parametrize(
    "wait",
    [
        "subscriber.recv()",
        "subscriber.recv(timeout=1000)",
        "subscriber.next_event()",
        "next(subscriber)",
        "list(subscriber.events())",
        "subscriber.lease().__enter__()",
    ],
)
@pytest.mark.parametrize("exists", [False, True], ids=["no topic", "topic"])
def test_ctrl_c_ends_a_wait(python, topic, wait, exists):
    publisher = Publisher(topic) if exists else None
    child = python(WAIT.replace("WAIT", wait), topic)
    child.expect("ready")
    wait_until_asleep(child.pid)
    child.signal(signal.SIGINT)
    child.expect("interrupted")
    assert child.end() == (0, "")
    if publisher:
        assert publisher.info().readers == ()
        publisher.close()


HANDLE = """
import signal, sys
from conduit_ring import Subscriber

subscriber = Subscriber(sys.argv[1])

def handle(*_):
    try:
        subscriber.try_read()
    except RuntimeError:
        print("busy", flush=True)
    subscriber.close()

signal.signal(signal.SIGTERM, handle)
print("ready", flush=True)
print(len(list(subscriber)), flush=True)
"""


def test_a_signal_handler_may_close_the_subscriber_that_waits(python, topic):
    child = python(HANDLE, topic)
    child.expect("ready")
    wait_until_asleep(child.pid)
    child.signal(signal.SIGTERM)
    assert child.end() == (0, "busy\n0\n")


def test_a_forked_child_can_neither_use_nor_close_its_parents(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        publisher.publish(b"before")
        child = os.fork()
        if child == 0:
            status = 1
            try:
                publish = lambda: publisher.publish(b"child")  # noqa: E731
                for use in [publish, publisher.info, subscriber.try_read, subscriber.recv]:
                    with pytest.raises(RuntimeError, match="forked from"):
                        use()
                assert publisher.closed and subscriber.closed
                publisher.close()
                subscriber.close()
                del use, publisher, subscriber
                gc.collect()
                with Subscriber(topic, start="latest") as own:
                    assert bytes(own.recv(timeout=0)) == b"before"
                status = 0
            finally:
                os._exit(status)
        assert os.waitpid(child, 0)[1] == 0
        assert info(topic).state == "live"
        assert publisher.publish(b"after") == 1
        assert [bytes(subscriber.recv(timeout=0)) for _ in range(2)] == [b"before", b"after"]


def held():
    gc.collect()
    return len(os.listdir("/proc/self/fd")), len(threads()), mappings()


def threads():
    return set(os.listdir("/proc/self/task"))


def mappings():
    with open("/proc/self/maps") as maps:
        return sum("conduit_test" in line for line in maps)


def use(topic, explicitly):
    publisher, subscriber = Publisher(topic), Subscriber(topic)
    early = Subscriber(topic + "-missing")
    publisher.publish(b"x")
    assert subscriber.recv(timeout=0)
    publisher.publish(b"y")
    with subscriber.lease(timeout=0):
        pass
    subscriber.info()
    assert early.try_read() is None
    if explicitly:
        publisher.close()
        subscriber.close()
        early.close()


@pytest.mark.parametrize(
    "explicitly, times", [(True, 1000), (False, 200)], ids=["closed", "collected"]
)
def test_a_thousand_opens_leave_no_descriptor_thread_or_mapping(topic, explicitly, times):
    # A thread that has ended is listed for a moment, perhaps one of an earlier test.
    others = threads()
    for _ in range(10):
        use(topic, explicitly)
    eventually(lambda: threads() <= others)
    descriptors, _, mapped = held()
    for _ in range(times):
        use(topic, explicitly)
    eventually(lambda: threads() <= others and held()[::2] == (descriptors, mapped))


def test_opens_that_fail_leave_nothing(topic):
    with Publisher(topic):
        before = held()
        for _ in range(200):
            with pytest.raises(Exception):
                Publisher(topic)
            with pytest.raises(ValueError):
                Subscriber(topic, start="wrong")
        assert held() == before


def resident_kib():
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGESIZE") // 1024


def test_messages_that_are_let_go_leave_no_memory(topic):
    message = bytes(1_000_000)
    large = Publisher(topic, slot_count=2, slot_size=1_000_020)
    with large as publisher, Subscriber(topic) as subscriber:

        def exchange(times):
            for _ in range(times):
                publisher.publish(message)
                subscriber.recv(timeout=0).array("u1", (1000, 1000))
                publisher.publish(bytearray(message))
                with subscriber.lease() as frame:
                    frame.data[10:20], frame.array()

        exchange(20)
        before = resident_kib()
        exchange(200)
        # 400 messages are 400 MB.
        assert resident_kib() < before + 50_000


def test_a_program_that_ends_without_closing_leaves_its_topic_to_the_next(python, topic):
    child = python(
        "import os, sys; from conduit_ring import Publisher; "
        "p = Publisher(sys.argv[1]); p.publish(b'x'); os._exit(0)",
        topic,
    )
    assert child.end() == (0, "")
    assert info(topic).state == "dead"
    with Publisher(topic) as publisher:
        assert publisher.publish(b"y") == 1


def test_waits_in_daemon_threads_do_not_keep_python_from_ending(python, topic):
    program = """
import sys, threading
from conduit_ring import Subscriber
subscriber = Subscriber(sys.argv[1])
threading.Thread(target=subscriber.recv, daemon=True).start()
while not subscriber.publisher_up:
    pass
print("over", flush=True)
"""
    with Publisher(topic):
        child = python(program, topic)
        child.expect("over")
        assert child.end() == (0, "")


def test_ten_subscribers_in_threads_get_every_message(topic):
    with Publisher(topic, slot_count=512) as publisher:
        subscribers = [Subscriber(topic) for _ in range(10)]
        seen = [[] for _ in subscribers]

        def read(subscriber, seen):
            for message in subscriber:
                seen.append(message.sequence)
                if len(seen) == 300:
                    return

        threads = [threading.Thread(target=read, args=pair) for pair in zip(subscribers, seen)]
        for thread in threads:
            thread.start()
        for n in range(300):
            publisher.publish(n.to_bytes(4, "little"))
        for thread in threads:
            thread.join(LIMIT)
        assert seen == [list(range(300))] * 10
        for subscriber in subscribers:
            subscriber.close()


def file_of(topic):
    return pathlib.Path("/dev/shm") / f"conduit_{topic}"


def eventually(happens):
    deadline = time.monotonic() + 60
    while not happens():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_silent_publisher_makes_a_removed_file_anew(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        publisher.publish(b"before")
        for _ in range(3):
            file_of(topic).unlink()
            eventually(file_of(topic).exists)
        assert publisher.publish(b"after") == 1
        assert [bytes(subscriber.recv(timeout=LIMIT)) for _ in range(2)] == [b"before", b"after"]
    assert not file_of(topic).exists()


def test_a_publisher_whose_name_another_has_says_who(topic):
    def usurp():
        file_of(topic).unlink(missing_ok=True)
        try:
            return Publisher(topic)
        except PublisherAliveError:  # its file was created again before
            return usurp()

    def is_lost():
        try:
            publisher.publish(b"to nobody")
        except NameLostError as error:
            assert f"process {os.getpid()} publishes this topic" in str(error)
            return True
        return False

    with Publisher(topic) as publisher:
        with usurp():
            eventually(is_lost)
        eventually(lambda: not is_lost())


def test_a_loan_keeps_its_file_although_that_is_removed(topic):
    with Publisher(topic) as publisher, Subscriber(topic) as subscriber:
        with publisher.loan(4) as loan:
            file_of(topic).unlink()
            time.sleep(0.7)  # for a check of the name, which would move the publisher away
            loan.data[:] = b"lent"
        assert bytes(subscriber.recv(timeout=LIMIT)) == b"lent"


def test_a_publisher_that_is_garbage_has_closed_its_topic(topic):
    for _ in range(20):
        publisher = Publisher(topic)
        del publisher
        assert not file_of(topic).exists()
