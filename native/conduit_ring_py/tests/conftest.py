"""What the tests share: topics of their own, other processes."""

import itertools
import os
import subprocess
import sys

import pytest

LIMIT = 60.0
"""Longer than anything here takes: only a failing test waits so long. Seconds."""

_count = itertools.count()


@pytest.fixture
def topic():
    """A topic of a name of its own, whose file is removed afterwards."""
    name = f"{os.environ.get('GANGLION_RUN', 'run')}.{os.getpid()}.{next(_count)}.py"
    yield name
    try:
        os.remove(f"/dev/shm/conduit_{name}")
    except FileNotFoundError:
        pass


class Process:
    """Another process, which says line by line how far it is."""

    def __init__(self, *command):
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        self.pid = self._child.pid

    def expect(self, line):
        """Waits for its next line, which must be this one."""
        assert self._child.stdout.readline().rstrip("\n") == line

    def go(self):
        """Sends it a line."""
        self._child.stdin.write("\n")

    def signal(self, number):
        """Sends it a signal."""
        self._child.send_signal(number)

    def kill(self):
        """SIGKILL. It must have been running."""
        assert self._child.poll() is None, "it ended by itself"
        self._child.kill()
        self._child.wait()

    def end(self):
        """Ends its input, and gives its exit status and the rest of what it said."""
        rest, _ = self._child.communicate(timeout=LIMIT)
        return self._child.returncode, rest

    def give_up(self):
        """Leaves nothing behind."""
        self._child.kill()
        self._child.communicate()


@pytest.fixture
def start():
    """Starts processes that do not outlive the test."""
    processes = []

    def start(*command):
        process = Process(*map(str, command))
        processes.append(process)
        return process

    yield start
    for process in processes:
        process.give_up()


@pytest.fixture
def rust_peer(start):
    """Starts peer/, the other end in Rust."""
    return lambda *arguments: start(os.environ["CONDUIT_RING_PEER"], *arguments)


@pytest.fixture
def python(start):
    """Starts a Python program with these arguments."""
    return lambda program, *arguments: start(sys.executable, "-c", program, *arguments)
