"""The time of a fit: what has begun is given up when it is over, and the proof a tenth of it later."""

import pytest

from jhd._runtime.clock import Clock, OutOfTimeError


def clock_at(monkeypatch, *times):
    monkeypatch.setattr("jhd._runtime.clock.time.monotonic", iter(times).__next__)


def test_an_evaluation_is_given_up_when_the_time_is_over(monkeypatch):
    clock_at(monkeypatch, 100.0, 104.0, 106.0)
    clock = Clock(5)
    clock.heard(None)
    with pytest.raises(OutOfTimeError):
        clock.heard(None)


def test_the_proof_has_a_tenth_of_the_time_more(monkeypatch):
    clock_at(monkeypatch, 100.0, 105.4, 105.6)
    clock = Clock(5)
    clock.closing(None)
    with pytest.raises(KeyboardInterrupt):
        clock.closing(None)


def test_without_a_limit_nothing_ends(monkeypatch):
    # No time is asked for.
    clock_at(monkeypatch)
    clock = Clock()
    clock.check()
    clock.closing(None)
    assert not clock.is_over()
