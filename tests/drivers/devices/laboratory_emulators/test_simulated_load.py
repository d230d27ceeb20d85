"""The simulated load sensor at the wrist."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.laboratory_emulators.simulated_load import SimLoadSensor
from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.drivers.interfaces import LoadSensor
from pomona.executive.cell.connect import load_cell

CELL = Path(__file__).resolve().parents[4] / "trees" / "cells" / "sim_wrist.yaml"


def test_it_measures_what_pulls_at_the_hand_and_its_faults_are_noticed() -> None:
    with contextlib.closing(load_cell(CELL)) as cell:
        sensor = cell.devices["load"]
        assert isinstance(sensor, SimLoadSensor)
        assert isinstance(sensor, LoadSensor)
        world = sensor._world
        samples: list[np.ndarray] = []
        sensor.subscribe(lambda sample: samples.append(sample.wrenches[0]))
        cell.clock.advance(0.5)
        assert len(samples) == 50
        rest = np.mean(samples[10:], axis=0)
        hand = world.model.body("tool0").id
        world.state.xfrc_applied[hand, :3] = [
            0.0,
            0.0,
            -3.0,
        ]  # in the base frame, at the body's centre of mass
        samples.clear()
        cell.clock.advance(1.0)
        axes = world.state.xmat[hand].reshape(3, 3)
        arm_to_force = world.state.xipos[hand] - world.state.xpos[hand]
        change = np.mean(samples[50:], axis=0) - rest
        np.testing.assert_allclose(change[:3], axes.T @ [0.0, 0.0, -3.0], atol=0.1)
        np.testing.assert_allclose(
            change[3:], axes.T @ np.cross(arm_to_force, [0.0, 0.0, -3.0]), atol=0.02
        )
        cell.check()
        sensor.inject_fault("stuck")
        cell.clock.advance(0.2)
        with pytest.raises(DeviceFault, match="the load sensor has reported the same"):
            cell.check()
        for kind, noticed in (("zero", "has reported zero"), ("lost", "no sample for")):
            sensor.clear_fault()
            cell.clock.advance(0.1)
            sensor.acknowledge()
            sensor.inject_fault(kind)
            cell.clock.advance(0.2)
            with pytest.raises((DeviceFault, DeviceLost), match=noticed):
                cell.check()
