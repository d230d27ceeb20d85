"""A PLC in an emulated cell: the driver's bytes reach the simulated PLC on the world's time; faults are noticed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from pomona.devices.plc.signals import Signals
from pomona.drivers import Cell, DeviceError, load_cell

CELL = Path(__file__).resolve().parents[4] / "trees" / "cells" / "emulated_plc.yaml"


@pytest.fixture(scope="module")
def cell() -> Iterator[Cell]:
    cell = load_cell(CELL, overrides={"full": "1"})
    yield cell
    cell.close()


def after(cell: Cell, seconds: float) -> None:
    """Let time pass, with the run's ticks."""
    end = cell.clock.now() + seconds
    while cell.clock.now() < end - 1e-9:
        cell.clock.advance(0.02)
        cell.check()


@pytest.mark.slow
def test_signals_go_both_ways_and_a_loss_makes_them_unknown_and_safe(cell: Cell) -> None:
    plc, memory = cell.device(Signals), cell.switches["modbus-plc"].memory
    after(cell, 0.1)
    assert (plc.read("start").value, plc.read("crate_full").value) == (False, False)
    plc.write("ready", True)
    after(cell, 0.7)
    assert plc.read("start").value is True  # the PLC's rule: 500 ms after ready
    plc.write("done", True)
    after(cell, 0.1)
    assert plc.read("crate_full").value is True
    cell.switches["modbus-plc.wire"].inject_fault("silent")
    with pytest.raises(DeviceError, match="does not answer as unit 1 within 200 ms"):
        after(cell, 1.0)
    assert plc.read("crate_full").value is None
    assert not cell.safe_stop("the PLC is silent")
    cell.switches["modbus-plc.wire"].clear_fault()
    cell.clock.advance(1.0)
    assert memory["coil"][1:4] == [0, 0, 0]
    cell.acknowledge()
    after(cell, 0.1)
    assert plc.read("ready").value is False


@pytest.mark.slow
def test_a_program_that_stops_ends_the_run_and_the_outputs_are_safe(cell: Cell) -> None:
    plc, memory = cell.device(Signals), cell.switches["modbus-plc"].memory
    plc.write("busy", True)
    after(cell, 0.2)
    assert memory["coil"][2] == 1
    cell.switches["modbus-plc"].inject_fault("stopped")
    began = cell.clock.now()
    with pytest.raises(DeviceError, match="its program has stopped"):
        after(cell, 2.0)
    assert cell.clock.now() - began < 0.7
    assert not cell.safe_stop("the PLC has stopped")
    cell.clock.advance(0.1)
    assert memory["coil"][2] == 0
