"""The simulated belt: it carries, lets roll, brings and takes fruit, and counts."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.applications.conveyor.conveyor import Conveyor
from pomona.applications.conveyor.devices import SimConveyor
from pomona.applications.conveyor.world import ConveyorWorld
from pomona.drivers import Cell, CellFileError, load_cell
from pomona.drivers.errors import DeviceLost
from pomona.executive import find_cell


def belt(**settings: str) -> tuple[Cell, ConveyorWorld]:
    cell = load_cell(find_cell("conveyor"), seed=3, overrides=settings)
    world = cell.devices["world"]
    assert isinstance(world, ConveyorWorld)
    return cell, world


@pytest.mark.parametrize("speed", [0.05, 0.3, 0.5])
def test_fruit_that_stands_on_the_belt_goes_with_it(speed: float) -> None:
    cell, world = belt(belt=f"{speed} m/s", gap="0 mm..0 mm")
    for number in range(5):
        world.put(number, -0.8 + 0.15 * number, 0.02 * (number - 2))
    cell.clock.advance(0.4)
    stands = [number for number in range(5) if world.built.fruits[number].name != "lemon"]
    before = np.array([world.pose(number)[:3, 3] for number in stands])
    cell.clock.advance(1.0)
    moved = np.array([world.pose(number)[:3, 3] for number in stands]) - before
    assert moved == pytest.approx(np.tile([speed, 0.0, 0.0], (len(stands), 1)), abs=1e-4)
    cell.close()


def test_a_fruit_that_is_set_down_at_rest_is_taken_along_and_one_that_rolls_comes_to_rest_on_the_belt() -> (
    None
):
    cell, world = belt(belt="0.2 m/s", gap="0 mm..0 mm", fruit="apple_4")
    world.put(0, -0.7, 0.0, roll=0.15)
    along = int(world.model.joint("fruit_0").dofadr[0])
    cell.clock.advance(0.2)
    assert world.state.qvel[along] > 0.24
    cell.clock.advance(3.0)
    assert world.state.qvel[along] == pytest.approx(0.2, abs=0.03)
    cell.close()


@pytest.mark.slow
def test_the_belt_brings_fruit_and_what_has_passed_comes_again() -> None:
    cell, world = belt(belt="0.5 m/s", gap="200 mm..300 mm", fruit="apple_5", bodies="4")
    cell.clock.advance(12.0)
    truth = world.truth()
    offered, passed = truth["offered"], truth["passed"]
    assert isinstance(offered, int)
    assert isinstance(passed, int)
    assert offered > 8
    assert passed >= offered - 4
    assert (truth["lifted"], truth["collisions"], truth["drops"]) == (0, 0, 0)
    cell.close()


@pytest.mark.parametrize("of", ["cell", "belt"])
def test_belt_and_arm_stop_together_and_the_belt_stays_stopped(of: str) -> None:
    cell, world = belt(belt="0.3 m/s")
    cell.clock.advance(0.2)
    if of == "cell":
        cell.safe_stop("a hand in the way")
    else:
        assert cell.device(Conveyor).stop()
    assert not cell.settled()  # the belt brakes
    cell.clock.advance(0.3)
    assert world.speed == 0.0
    assert cell.settled()
    cell.acknowledge()
    conveyor = cell.devices["conveyor"]
    assert isinstance(conveyor, SimConveyor)
    conveyor.inject_fault("creep")
    conveyor.clear_fault()
    cell.clock.advance(0.3)
    assert world.speed == 0.0
    cell.close()


def test_the_encoder_counts_what_the_belt_has_run() -> None:
    cell, world = belt(belt="0.15 m/s", gap="0 mm..0 mm")
    conveyor = cell.device(Conveyor)
    cell.clock.advance(1.0)
    measured = conveyor.travelled()
    assert measured is not None
    assert measured.position == pytest.approx(world.travelled, abs=2e-3)
    assert measured.speed == pytest.approx(0.15, abs=1e-3)
    assert measured.stamp == pytest.approx(cell.clock.now(), abs=0.011)
    cell.close()


@pytest.mark.parametrize(
    ("fault", "speed", "measured"),
    [
        ("stop", 0.0, 0.0),
        ("creep", 0.1, 0.1),
        ("backwards", 0.15, -0.15),
        ("wrong_scale", 0.15, 0.165),
    ],
)
def test_faults_of_belt_and_encoder_show_in_speed_and_measurement(
    fault: str, speed: float, measured: float
) -> None:
    cell, world = belt(belt="0.15 m/s", gap="0 mm..0 mm")
    conveyor = cell.devices["conveyor"]
    assert isinstance(conveyor, SimConveyor)
    cell.clock.advance(0.5)
    conveyor.inject_fault(fault)
    cell.clock.advance(1.0)
    state = conveyor.travelled()
    assert state is not None
    assert world.speed == pytest.approx(speed, abs=2e-3)
    assert state.speed == pytest.approx(measured, abs=5e-3)
    conveyor.clear_fault()
    cell.clock.advance(1.0)
    assert world.speed == pytest.approx(0.15, abs=1e-3)
    cell.close()


def test_a_belt_that_jumps_carries_its_load_on_at_once() -> None:
    cell, world = belt(belt="0.15 m/s", gap="0 mm..0 mm", fruit="apple_4")
    conveyor = cell.devices["conveyor"]
    assert isinstance(conveyor, SimConveyor)
    world.put(0, -0.5, 0.0)
    cell.clock.advance(0.4)
    before = world.pose(0)[0, 3]
    conveyor.inject_fault("jump")
    cell.clock.advance(0.02)
    assert world.pose(0)[0, 3] - before == pytest.approx(0.033, abs=2e-3)
    cell.close()


def test_an_encoder_that_sends_nothing_is_lost() -> None:
    cell, _ = belt(gap="0 mm..0 mm")
    conveyor = cell.devices["conveyor"]
    assert isinstance(conveyor, SimConveyor)
    conveyor.inject_fault("lost")
    cell.clock.advance(0.3)
    with pytest.raises(DeviceLost, match="encoder sent nothing for 300 ms"):
        conveyor.check()
    cell.close()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"belt": "0.6 m/s"}, "0.5 m/s"),
        ({"fruit": "pear"}, "it cannot be 'pear'"),
        ({"lateral": "101 mm"}, "100 mm"),
    ],
)
def test_a_belt_that_cannot_be_is_refused_at_its_place_in_the_file(
    settings: dict[str, str], words: str
) -> None:
    with pytest.raises(CellFileError) as refused:
        belt(**settings)
    assert words in str(refused.value)
