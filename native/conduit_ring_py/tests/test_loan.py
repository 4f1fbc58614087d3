import gc

import numpy
import pytest

from conduit_ring import (
    ClosedError,
    MessageTooLargeError,
    Publisher,
    Subscriber,
)


@pytest.fixture
def publisher(topic):
    with Publisher(topic, slot_count=4, slot_size=100_020) as publisher:
        yield publisher


@pytest.fixture
def subscriber(topic, publisher):
    with Subscriber(topic) as subscriber:
        yield subscriber


def test_a_loan_is_published_when_its_block_is_left(publisher, subscriber):
    with publisher.loan(5) as loan:
        assert (loan.sequence, len(loan)) == (0, 5)
        assert "5 bytes for message 0" in repr(loan)
        loan.data[:] = b"bytes"
        assert subscriber.try_read() is None
    assert subscriber.recv(timeout=0).data == b"bytes"
    with publisher.loan(48) as loan:
        numbers = loan.array("<f8", (2, 3))
        numbers[:] = [[0, 1, 2], [3, 4, 5]]
    message = subscriber.recv(timeout=0)
    assert (message.sequence, message.lost) == (1, 0)
    assert message.array("<f8").tolist() == [0, 1, 2, 3, 4, 5]


def test_it_is_written_where_it_is_read(topic, publisher):
    with publisher.loan(100_000) as loan:
        loan.array()[:] = 7
        with open(f"/dev/shm/conduit_{topic}", "rb") as ring:
            assert ring.read().count(7) >= 100_000


def test_a_loan_whose_block_raises_publishes_nothing(publisher, subscriber):
    with pytest.raises(KeyError), publisher.loan(5) as loan:
        loan.data[:] = b"never"
        raise KeyError
    assert subscriber.try_read() is None
    assert publisher.publish(b"next") == 0
    message = subscriber.recv(timeout=0)
    assert (message.sequence, message.lost, message.data) == (0, 0, b"next")


def test_it_can_be_made_shorter_and_not_longer(publisher, subscriber):
    with publisher.loan(100) as loan:
        loan.data[:3] = b"jpg"
        loan.truncate(3)
        assert len(loan) == 3
        with pytest.raises(ValueError, match="longer, to 4 bytes"):
            loan.truncate(4)
    assert subscriber.recv(timeout=0).data == b"jpg"


def test_a_message_without_bytes_can_be_lent(publisher, subscriber):
    with publisher.loan(0) as loan:
        assert loan
    assert len(subscriber.recv(timeout=0)) == 0


def test_what_does_not_fit_is_not_lent(publisher):
    with pytest.raises(MessageTooLargeError), publisher.loan(publisher.max_message_size + 1):
        pass
    assert publisher.info().rejected_oversize == 1
    assert publisher.publish(b"x") == 0


def test_a_slot_that_a_lease_holds_is_passed_over(publisher, subscriber):
    publisher.publish(b"first")
    with subscriber.lease():
        pass
    publisher.publish(b"held")
    with subscriber.lease() as lease:
        assert lease.holds_slot
        for _ in range(3):
            publisher.publish(b"x")
        with publisher.loan(1) as loan:
            assert loan.sequence == 6
        assert publisher.info().dropped_pinned == 1


def test_nothing_else_is_published_while_it_is_out(publisher):
    with publisher.loan(1) as loan:
        with pytest.raises(RuntimeError, match="outstanding loan"):
            publisher.publish(b"x")
        with pytest.raises(RuntimeError, match="outstanding loan"), publisher.loan(1):
            pass
        assert publisher.info().published == 0
        loan.data[:] = b"y"
    assert publisher.publish(b"z") == 1


def test_it_cannot_be_used_outside_its_block(publisher):
    loan = publisher.loan(5)
    uses = [
        lambda: loan.data,
        lambda: loan.sequence,
        lambda: len(loan),
        lambda: loan.truncate(1),
        loan.array,
    ]
    for use in uses:
        with pytest.raises(ValueError, match="is not entered"):
            use()
    assert repr(loan) == "<Loan of 5 bytes, not entered>"
    with loan:
        for use in uses:
            use()
        owner = loan.data.obj
    for use in uses:
        with pytest.raises(ValueError, match="ended with its block"):
            use()
    with pytest.raises(ValueError, match="entered already"), loan:
        pass
    with pytest.raises(BufferError):
        memoryview(owner)
    assert repr(loan) == "<Loan, ended>"


def test_what_was_handed_out_cannot_be_written_to_after_the_block(publisher):
    with publisher.loan(5) as loan:
        view, array = loan.data, loan.array()
        array[:] = 7
    with pytest.raises(ValueError, match="released"):
        view[0] = 1
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 1
    assert array.tolist() == [7] * 5


def test_an_array_kept_beyond_the_publisher_leads_somewhere(topic):
    with Publisher(topic, slot_size=100_020) as publisher:
        with publisher.loan(100_000) as loan:
            array = loan.array()
            array[:] = 7
    del publisher, loan
    gc.collect()
    assert (array.min(), array.max()) == (7, 7)


def test_a_publisher_that_closes_inside_the_block_publishes_nothing(publisher, subscriber):
    with pytest.raises(ClosedError), publisher.loan(5) as loan:
        array = loan.array()
        publisher.close()
        array[:] = 7
    assert subscriber.try_read() is None


def test_one_that_was_entered_and_never_left_is_cancelled(publisher):
    loan = publisher.loan(5)
    loan.__enter__()
    with pytest.raises(RuntimeError):
        publisher.publish(b"x")
    del loan
    gc.collect()
    assert publisher.publish(b"x") == 0


def test_a_wrong_size_is_refused(publisher):
    with pytest.raises(OverflowError):
        publisher.loan(-1)
    with pytest.raises(TypeError):
        publisher.loan("x")


def test_numpy_is_not_needed_for_views(publisher, subscriber):
    with publisher.loan(8) as loan:
        loan.data.cast("B").cast("d")[0] = 2.5
    assert numpy.frombuffer(subscriber.recv(timeout=0), "<f8").tolist() == [2.5]
