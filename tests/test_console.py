"""What commands share: an interrupt is heard wherever it comes, and the status says so."""

import _thread
import gc
import signal
import sys
import time

import pytest

from jhd._cli import console
from jhd._cli.console import busy, interrupts_heard
from jhd.progress import Progress


def wait():
    """Runs on until it is interrupted, or for long."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        pass


class Dropper:
    """A finalizer in which an interrupt comes; what it raises there, Python drops."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_in_a_finalizer_is_sent_again():
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


def test_on_a_terminal_the_seconds_go_on_while_nothing_is_reported_and_end_with_the_block(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(console, "_SECOND", 0.01)
    with busy("compiling") as show:
        time.sleep(0.2)
        show(Progress("halfway", 1))
        time.sleep(0.2)
    shown = capsys.readouterr().err.split("\r\x1b[K")
    assert shown.count("compiling ..., 0 s") > 2 and shown.count("halfway, 0 s") > 2
    assert shown[-1] == ""
    time.sleep(0.1)
    assert capsys.readouterr().err == ""
