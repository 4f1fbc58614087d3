import dataclasses
import os
import time

import pytest

import conduit_ring
from conduit_ring import NoTopicError, Publisher, Subscriber, content_tag, info, now_ns, topics


def test_topics_are_those_that_there_are(topic):
    assert topic not in topics()
    with Publisher(topic), Publisher(topic + ".b"):
        assert {topic, topic + ".b"} <= set(topics())
        names = topics()
        assert names == sorted(names)
    assert topic not in topics()


def test_files_that_are_no_topics_are_not_listed(topic):
    odd = f"/dev/shm/conduit_{topic} with a\nnew line"
    open(odd, "w").close()
    try:
        assert not any("new line" in name for name in topics())
    finally:
        os.remove(odd)


def test_topics_by_the_names_of_others_are_read_and_listed(topic):
    found = f"front:rgb {topic}"
    with Publisher(topic) as publisher:
        os.rename(f"/dev/shm/conduit_{topic}", f"/dev/shm/conduit_{found}")
        try:
            assert found in topics()
            assert info(found).published == 0
            with Subscriber(found) as subscriber:
                publisher.publish(b"seen")
                assert subscriber.recv(timeout=30).data == b"seen"
        finally:
            os.remove(f"/dev/shm/conduit_{found}")


def test_info_tells_all_about_a_topic(topic):
    with Publisher(topic, slot_count=4, slot_size=128, content="conduit/frame") as publisher:
        with Subscriber(topic) as subscriber:
            publisher.publish(b"x")
            publisher.publish(b"y")
            subscriber.recv(timeout=0)
            seen = info(topic)
        assert (seen.topic, seen.slot_count) == (topic, 4)
        assert (seen.slot_size, seen.max_message_size) == (128, 108)
        assert (seen.state, seen.published, seen.epoch) == ("live", 2, 0)
        assert (seen.content, seen.encoding) == (content_tag("conduit/frame"), "conduit/frame")
        assert 0 < seen.last_publish_ns <= now_ns()
        assert seen.instance_id != 0
        assert (seen.dropped_pinned, seen.rejected_oversize) == (0, 0)
        (reader,) = seen.readers
        assert (reader.native, reader.alive) == (True, True)
        assert (reader.next_sequence, reader.lost) == (1, 0)
        assert reader.pid == seen.writer_pid
        assert info(topic).readers == ()
        assert dataclasses.replace(seen, readers=()).instance_id == publisher.info().instance_id
        with pytest.raises(dataclasses.FrozenInstanceError):
            seen.published = 3


def test_an_encoding_that_is_not_known_has_no_name(topic):
    for content in [None, "my/own", 5]:
        with Publisher(topic, content=content) as publisher:
            assert publisher.info().encoding is None


def test_info_about_no_topic_is_an_error(topic):
    with pytest.raises(NoTopicError, match=f"conduit_{topic}: there is no such topic"):
        info(topic)


def test_a_damaged_file_is_an_error(topic):
    with open(f"/dev/shm/conduit_{topic}", "wb") as file:
        file.write(b"\xff" * 5000)
    with pytest.raises(conduit_ring.BadSegmentError, match=topic):
        info(topic)
    with pytest.raises(conduit_ring.BadSegmentError, match=topic):
        Subscriber(topic)


def test_what_the_operating_system_refuses_is_an_oserror(topic):
    os.symlink("/nowhere", f"/dev/shm/conduit_{topic}")
    with pytest.raises(OSError) as caught:
        info(topic)
    assert caught.value.errno
    assert caught.value.filename.endswith(topic)


def test_the_clock_is_monotonic_raw():
    before = time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)
    now = now_ns()
    assert before <= now <= time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)
    wall = now_ns() + conduit_ring.realtime_offset_ns()
    assert abs(wall - time.time_ns()) < 60 * 10**9
