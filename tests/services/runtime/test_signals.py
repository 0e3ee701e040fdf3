"""Signals that end a process: heard on a thread, once, and by nobody else."""

import os
import queue
import signal
import subprocess
import sys
import threading

import pytest

from services.runtime.signals import NUMBERS, Stop, StopSignals, heard_by_children

WAIT_S = 20.0
OBSTINATE = """
import threading
from services.runtime.signals import StopSignals
StopSignals(lambda: print("first", flush=True), same_s=0.0)
print("ready", flush=True)
threading.Event().wait()
"""
PATIENT = """
import signal, sys
from services.runtime.signals import NUMBERS, StopSignals
with StopSignals(lambda: print("first", flush=True), same_s=60.0):
    print("ready", flush=True)
    sys.stdin.readline()
    while signal.sigpending() & set(NUMBERS):
        pass
print("whole", flush=True)
"""
"""Leaving the block waits until the thread has read every signal that was heard."""


def tell(number: signal.Signals) -> None:
    """Send a signal to this process, as another one would."""
    os.kill(os.getpid(), number)


@pytest.mark.parametrize("number", NUMBERS)
def test_the_first_signal_is_told_on_a_thread_of_its_own(number: signal.Signals) -> None:
    told: queue.Queue[threading.Thread] = queue.Queue()
    with StopSignals(lambda: told.put(threading.current_thread())):
        tell(number)
        assert told.get(timeout=WAIT_S) is not threading.main_thread()


def test_a_timed_wait_of_the_main_thread_ends_in_time_though_a_signal_takes_longer() -> None:
    begun, waited = threading.Event(), threading.Event()
    ends: list[bool] = []

    def take_long() -> None:
        begun.set()
        ends.append(waited.wait(WAIT_S))

    with StopSignals(take_long):
        tell(signal.SIGTERM)
        with pytest.raises(queue.Empty):
            queue.SimpleQueue[None]().get(timeout=0.01)
        assert begun.wait(WAIT_S)
        waited.set()
    assert ends == [True]


@pytest.mark.real
def test_two_signals_at_once_are_one() -> None:
    """In a process of its own: were they two, the second would end it at once."""
    command = [sys.executable, "-c", PATIENT]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.terminate()
        assert process.stdout.readline() == "first\n"
        process.send_signal(signal.SIGINT)
        rest, _ = process.communicate("both were sent\n", timeout=WAIT_S)
    assert (process.returncode, rest) == (0, "whole\n")


@pytest.mark.real
@pytest.mark.parametrize("number", NUMBERS)
def test_a_second_signal_ends_the_process_at_once(number: signal.Signals) -> None:
    with subprocess.Popen([sys.executable, "-c", OBSTINATE], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        process.terminate()
        assert process.stdout.readline() == "first\n"
        process.send_signal(number)
        assert process.wait(WAIT_S) == 128 + number


def test_the_signals_are_given_back_as_they_were() -> None:
    def before() -> list[object]:
        return [*map(signal.getsignal, NUMBERS), signal.pthread_sigmask(signal.SIG_BLOCK, ())]

    found, threads = before(), threading.active_count()
    with StopSignals(lambda: None):
        assert before() != found
    assert (before(), threading.active_count()) == (found, threads)
    outside = signal.set_wakeup_fd(-1)
    signal.set_wakeup_fd(outside)
    assert outside == -1


def test_what_was_blocked_at_the_start_is_blocked_again_and_nothing_else() -> None:
    def blocked() -> set[int]:
        return set(signal.pthread_sigmask(signal.SIG_BLOCK, ())) & set(NUMBERS)

    masks = []
    before = signal.pthread_sigmask(signal.SIG_BLOCK, NUMBERS)
    try:
        for mask in ((), (signal.SIGTERM,), NUMBERS):
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            with heard_by_children():
                for_children = blocked()
            again = blocked()
            with StopSignals(lambda: None):
                inside = blocked()
            masks.append((for_children, again, inside, blocked()))
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    starts: list[set[int]] = [set(), {signal.SIGTERM}, set(NUMBERS)]
    assert masks == [(set(), start, set(NUMBERS), start) for start in starts]


@pytest.mark.real
def test_a_child_hears_the_signals_that_its_parent_keeps_from_its_main_thread() -> None:
    masks = []
    for told in (True, False):
        with StopSignals(lambda: None):
            command = [sys.executable, "-c", "import signal; print(signal.pthread_sigmask(0, ()) >= {2, 15})"]
            if told:
                with heard_by_children():
                    done = subprocess.run(command, check=True, capture_output=True, text=True)
            else:
                done = subprocess.run(command, check=True, capture_output=True, text=True)
        masks.append(done.stdout)
    assert masks == ["False\n", "True\n"]


def test_whoever_waits_is_interrupted_where_it_looks_and_only_there() -> None:
    stop = Stop()
    stop.look()
    stop.pause(0)
    stop.set()
    with pytest.raises(KeyboardInterrupt):
        stop.look()
    with pytest.raises(KeyboardInterrupt):
        stop.pause(WAIT_S)
