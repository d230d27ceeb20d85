"""The simulated PLC: each rule of a cell file, its faults, and its safe values."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.devices.plc import simulated
from pomona.devices.plc.signals import SignalNames
from pomona.drivers import CellFileError, ConnectContext, DeviceFault, MotionRefused
from pomona.executive import ManualClock
from tests.drivers.device_settings import read_settings

RULES = """\
driver: sim-signals
outputs: [ready, done, change]
inputs:
  start: {follows: ready, delay: 500 ms}
  full: {counts: done, most: 2, cleared_by: change}
  fault: {during: 3 s..4 s}
  off: {}
  mass: {number: 2.5}
"""


def plc(folder: Path, clock: ManualClock, text: str = RULES) -> simulated.SimSignals:
    path = folder / "plc.yaml"
    path.write_text(text)
    return simulated.connect(read_settings(simulated.connect, path), ConnectContext(path, clock, 0))


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def signals(tmp_path: Path, clock: ManualClock) -> simulated.SimSignals:
    return plc(tmp_path, clock)


def test_an_input_follows_an_output_with_a_delay(
    signals: simulated.SimSignals, clock: ManualClock
) -> None:
    clock.advance(1.0)
    assert signals.read("start").value is False
    signals.write("ready", True)
    clock.advance(0.49)
    assert signals.read("start").value is False
    clock.advance(0.02)
    assert signals.read("start").value is True
    signals.write("ready", False)
    clock.advance(0.51)
    assert signals.read("start").value is False


def test_an_input_counts_the_rises_of_an_output(
    signals: simulated.SimSignals, clock: ManualClock
) -> None:
    for full in (False, True, True):
        clock.advance(0.1)
        signals.write("done", True)
        clock.advance(0.1)
        signals.write("done", False)
        assert signals.read("full").value is full
    clock.advance(0.1)
    signals.write("change", True)
    assert signals.read("full").value is False


def test_an_input_is_on_during_a_time_and_others_stay(
    signals: simulated.SimSignals, clock: ManualClock
) -> None:
    assert (signals.read("fault").value, signals.read("off").value, signals.read("mass").value) == (
        False,
        False,
        2.5,
    )
    clock.advance(3.5)
    assert signals.read("fault").value is True
    clock.advance(1.0)
    assert signals.read("fault").value is False
    assert signals.newest().stamp == clock.now()
    assert signals.names == SignalNames(
        ("start", "full", "fault", "off", "mass"), ("ready", "done", "change"), {"mass"}
    )


def test_a_program_that_stops_makes_values_unknown_and_then_the_device_faulty(
    signals: simulated.SimSignals, clock: ManualClock
) -> None:
    signals.inject_fault("stopped")
    clock.advance(0.3)
    assert signals.read("start").value is None
    signals.check()
    clock.advance(0.3)
    with pytest.raises(DeviceFault, match="heartbeat stands still"):
        signals.check()
    signals.clear_fault()
    with pytest.raises(DeviceFault, match="heartbeat stands still"):
        signals.check()
    signals.acknowledge()
    signals.check()
    assert signals.read("start").value is False


def test_a_safe_stop_switches_the_outputs_off_until_it_is_acknowledged(
    signals: simulated.SimSignals,
) -> None:
    signals.write("ready", True)
    signals.safe_stop("the operator")
    assert signals.read("ready").value is False
    with pytest.raises(MotionRefused, match="the operator"):
        signals.write("ready", True)
    signals.acknowledge()
    signals.write("ready", True)
    assert signals.read("ready").value is True
    with pytest.raises(MotionRefused, match="no value of a switch"):
        signals.write("ready", 2.0)
    with pytest.raises(KeyError):
        signals.read("nothing")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("follows: ready", "follows: redy", "needs the output 'redy'.*did you mean 'ready'"),
        ("off: {}", "ready: {}", "'ready' is an input already"),
        ("number: 2.5", "number: 2.5, during: 1 s..2 s", "it has one rule"),
        ("3 s..4 s", "4 s..3 s", ":6:19: .*smaller end first"),
    ],
)
def test_wrong_rules_are_refused(
    tmp_path: Path, clock: ManualClock, old: str, new: str, words: str
) -> None:
    with pytest.raises(CellFileError, match=f"(?s){words}"):
        plc(tmp_path, clock, RULES.replace(old, new))
