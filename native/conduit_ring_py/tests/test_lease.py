import numpy
import pytest

from conduit_ring import LeaseLimitError, Publisher, RingError, SlotHeldError, Subscriber


@pytest.fixture
def publisher(topic):
    with Publisher(topic, slot_size=100_020) as publisher:
        yield publisher


@pytest.fixture
def subscriber(topic, publisher):
    with Subscriber(topic) as subscriber:
        yield subscriber


def test_a_lease_lends_the_next_message(publisher, subscriber):
    publisher.publish(b"one")
    publisher.publish(numpy.arange(6, dtype="<f8"))
    with subscriber.lease(timeout=0) as frame:
        assert (frame.sequence, frame.lost, len(frame)) == (0, 0, 3)
        assert frame.timestamp_ns > 0
        assert frame.data == frame.tobytes() == b"one"
        assert frame.data.readonly
        assert "message 0 of 3 bytes" in repr(frame)
    with subscriber.lease() as frame:
        assert frame.array("<f8", (2, 3)).tolist() == [[0, 1, 2], [3, 4, 5]]
        assert frame.array("<f8", offset=40).tolist() == [5]
    assert (subscriber.delivered, subscriber.try_read()) == (2, None)


def test_it_cannot_be_used_outside_its_block(publisher, subscriber):
    publisher.publish(b"x")
    lease = subscriber.lease()
    uses = [
        lambda: lease.data,
        lambda: lease.sequence,
        lambda: lease.timestamp_ns,
        lambda: lease.lost,
        lambda: lease.holds_slot,
        lambda: len(lease),
        lease.tobytes,
        lease.array,
    ]
    for use in uses:
        with pytest.raises(ValueError, match="is not entered"):
            use()
    with lease:
        for use in uses:
            use()
    for use in uses:
        with pytest.raises(ValueError, match="ended with its block"):
            use()
    with pytest.raises(ValueError, match="entered already"), lease:
        pass
    assert repr(lease) == "<Lease, ended>"


def test_a_view_of_it_raises_after_the_block_even_when_the_block_raised(publisher, subscriber):
    publisher.publish(b"x")
    with pytest.raises(KeyError), subscriber.lease() as frame:
        view = frame.data
        raise KeyError
    with pytest.raises(ValueError, match="released"):
        view[0]


def test_an_array_kept_beyond_the_block_never_shows_another_message(publisher, subscriber):
    publisher.publish(b"first")
    with subscriber.lease() as frame:
        array = frame.array()
        part = frame.data[1:3]
    for _ in range(100):
        publisher.publish(b"other")
        with subscriber.lease() as frame:
            assert frame.data == b"other"
    assert array.tobytes() == b"first"
    assert part == b"ir"


def test_a_loop_that_rebinds_its_array_goes_on(publisher, subscriber):
    for n in range(20):
        publisher.publish(bytes([n]) * 1000)
        with subscriber.lease() as frame:
            image = frame.array("u1", (10, 100))
        assert image.min() == image.max() == n


def test_three_leases_may_be_held_at_once(publisher, subscriber):
    for n in range(5):
        publisher.publish(bytes([n]))
    with subscriber.lease() as a, subscriber.lease() as b:
        with subscriber.lease() as c:
            assert [bytes(lease.data) for lease in (a, b, c)] == [b"\0", b"\1", b"\2"]
            with pytest.raises(LeaseLimitError, match="3 leases already"):
                subscriber.lease().__enter__()
        with subscriber.lease() as d:
            assert d.data == b"\3"
    assert issubclass(LeaseLimitError, RingError)


def test_any_number_of_arrays_may_be_kept(publisher, subscriber):
    kept = []
    for n in range(20):
        publisher.publish(bytes([n]) * 1000)
        with subscriber.lease(timeout=0) as frame:
            kept.append(frame.array())
    assert [(array.min(), array.max()) for array in kept] == [(n, n) for n in range(20)]


def is_in_the_ring(array, topic):
    address = array.ctypes.data
    with open("/proc/self/maps") as maps:
        for line in maps:
            start, end = (int(bound, 16) for bound in line.split()[0].split("-"))
            if start <= address < end:
                return line.rstrip().endswith(f"conduit_{topic}")
    raise AssertionError("no memory there")


def test_a_message_is_looked_at_where_it_lies(topic, publisher, subscriber):
    # The first lease may be a copy: the publisher does not check for held slots before it.
    for n in range(3):
        publisher.publish(bytes(100_000))
        with subscriber.lease() as frame:
            array = frame.array()
            held = frame.holds_slot
            assert is_in_the_ring(array, topic) == held
    assert held
    assert not is_in_the_ring(array, topic), "kept beyond its block"


def test_a_publisher_passes_a_lease_over(topic):
    with Publisher(topic, slot_count=4) as publisher, Subscriber(topic) as subscriber:
        for n in range(4):
            publisher.publish(b"%d" % n)
            with subscriber.lease():
                pass
        publisher.publish(b"held")
        with subscriber.lease() as frame:
            array = frame.array()
            for _ in range(3):
                publisher.publish(b"others")
            assert publisher.publish(b"behind it") == 9
            assert bytes(frame.data) == array.tobytes() == b"held"
            assert frame.holds_slot
        assert publisher.info().dropped_pinned == 1


def test_a_publisher_drops_a_message_when_every_slot_is_held(topic):
    with Publisher(topic, slot_count=1) as publisher, Subscriber(topic) as subscriber:
        publisher.publish(b"first")
        with subscriber.lease():
            pass
        publisher.publish(b"held")
        with subscriber.lease() as frame:
            assert frame.holds_slot
            with pytest.raises(SlotHeldError, match="hold all slots"):
                publisher.publish(b"dropped")
        assert publisher.publish(b"on") == 2


def test_a_lease_that_timed_out_is_not_held(subscriber, publisher):
    for _ in range(5):
        with pytest.raises(TimeoutError), subscriber.lease(timeout=0):
            pass
    publisher.publish(b"x")
    with subscriber.lease() as frame:
        assert frame.data == b"x"


def test_views_do_not_change_when_the_subscriber_closes_inside_the_block(publisher, subscriber):
    publisher.publish(b"still")
    with subscriber.lease() as frame:
        subscriber.close()
        publisher.close()
        assert frame.data == b"still"
