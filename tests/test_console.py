"""What commands share: an interrupt is heard wherever it comes, and the status says so."""

import _thread
import gc
import signal
import sys
import time

import pytest

from jhd.console import interrupts_heard


def wait():
    """Runs on until it is interrupted, or for long."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        pass


class Dropper:
    """A finaliser in which an interrupt comes; what it raises there, Python drops."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_in_a_finaliser_is_sent_again():
    with pytest.raises(KeyboardInterrupt), interrupts_heard():
        dropper = [Dropper()]
        dropper.clear()
        wait()


def test_an_interrupt_in_a_function_of_the_garbage_collector_is_sent_again():
    def during(phase, _):
        gc.callbacks.remove(during)
        _thread.interrupt_main()

    gc.callbacks.append(during)
    with pytest.raises(KeyboardInterrupt), interrupts_heard():
        gc.collect()
        wait()


def test_what_else_is_dropped_is_told_as_before(monkeypatch):
    told = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)

    class Wrong:
        def __del__(self):
            raise ValueError("wrong")

    with interrupts_heard():
        wrong = [Wrong()]
        wrong.clear()
    assert [x.exc_type for x in told] == [ValueError] and sys.unraisablehook == told.append
