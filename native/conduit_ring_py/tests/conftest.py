"""Fixtures: unique topics and other processes."""

import itertools
import os
import subprocess
import sys

import pytest

LIMIT = 60.0
"""The timeout of every wait in seconds, far longer than a passing test needs."""

_count = itertools.count()


@pytest.fixture
def topic():
    """A unique topic name. Its file is removed after the test."""
    name = f"{os.environ.get('GANGLION_RUN', 'run')}.{os.getpid()}.{next(_count)}.py"
    yield name
    try:
        os.remove(f"/dev/shm/conduit_{name}")
    except FileNotFoundError:
        pass


class Process:
    """Another process, which prints a line at each step."""

    def __init__(self, *command):
        self._child = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self.pid = self._child.pid

    def expect(self, line):
        """Wait for the next line and check it."""
        assert self._child.stdout.readline().rstrip("\n") == line

    def go(self):
        """Send a line."""
        self._child.stdin.write("\n")

    def signal(self, number):
        """Send a signal."""
        self._child.send_signal(number)

    def kill(self):
        """Kill the process, which must be running."""
        assert self._child.poll() is None, "it ended by itself"
        self._child.kill()
        self._child.wait()

    def end(self):
        """Close the input. Return the exit status and the rest of the output."""
        rest, _ = self._child.communicate(timeout=LIMIT)
        return self._child.returncode, rest

    def give_up(self):
        """Kill the process if it is running."""
        self._child.kill()
        self._child.communicate()


@pytest.fixture
def start():
    """Start processes that do not outlive the test."""
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
    """Start the Rust peer, peer/."""
    return lambda *arguments: start(os.environ["CONDUIT_RING_PEER"], *arguments)


@pytest.fixture
def python(start):
    """Start a Python program with arguments."""
    return lambda program, *arguments: start(sys.executable, "-c", program, *arguments)
