"""The score's minimum grip force is where the engine itself lets a held fruit slip."""

from types import SimpleNamespace

import numpy as np
import pytest

from pomona.tools.simulation.fingers import SimFingers
from pomona.tools.simulation.layout import PADS
from pomona.tools.simulation.score import SLID_OUT, FruitRecord, Grip, Scorer


@pytest.mark.parametrize("friction", ["0.5", "0.9"])
@pytest.mark.slow
def test_slip_begins_at_the_least_force(open_cell, probe_of, pick_with, friction):
    cell = open_cell(seed=9, fruit="apple_1", friction=friction, mass="200 g")
    probe = probe_of(cell)
    pick_with(probe)
    assert cell.truth()["lifted"] is True
    exact = SimFingers(probe.world, noise=0.0, bias=0.0, force_range=100.0)
    least = probe.world.score._least_force()
    assert least >= 0.99 * 0.2 * 9.81 / float(
        friction
    )  # a twist of the fruit only adds to its weight
    slips, pressed, loads = [cell.truth()["slip_mm"]], [0.0], [least]
    while (
        len(slips) < 3 or slips[-1] < slips[-2] + 0.02
    ):  # ease the grip until it slips by 1 mm/s, slowly at the end
        probe.force_wanted -= 0.02 if len(slips) < 3 or pressed[-1] > 1.15 * loads[-1] else 0.001
        cell.clock.advance(0.02)
        slips.append(cell.truth()["slip_mm"])
        pressed.append(float(-exact.latest().wrenches[:, 2].sum()))
        loads.append(probe.world.score._least_force())
        assert probe.force_wanted > 0.0
    # Several points of contact resist a twist a little better than the one of the ellipsoid.
    assert 0.94 < pressed[-2] / loads[-2] < 1.01


class StandingScore(Scorer):
    """Of a world in which nothing moves, but the fruit where it is put."""

    fallen = 0.0

    def _tool(self):
        return np.eye(4)

    def _pose(self, _fruit):
        pose = np.eye(4)
        pose[2, 3] = -self.fallen
        return pose

    def _normal_forces(self, _sensors):
        return (1.0, 1.0)

    def _tool_speed(self):
        return 0.1

    def _least_force(self):
        return 1.0

    def _measure_slip(self, _grip, _T_tool_fruit):
        pass


@pytest.mark.parametrize(("fallen", "drops"), [(0.5 * SLID_OUT, 0), (1.5 * SLID_OUT, 1)])
def test_contacts_that_part_again_and_again_are_no_drop_as_long_as_the_fruit_stays(
    fallen: float, drops: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = FruitRecord(np.eye(4), np.eye(4), grip=Grip(np.eye(4), np.zeros(3), hung=True))
    score = StandingScore.__new__(StandingScore)
    score._carriers = ("table",)
    score.state = SimpleNamespace(time=1.0)

    def step(force: float) -> None:
        score.state.time += 0.01
        pressing = dict.fromkeys(PADS, np.full(3, force))
        score._presses = SimpleNamespace(force=lambda _, name: pressing.get(name, np.zeros(3)))
        score._watch_grip(0, record)

    for force in (1.0, 0.0, 0.0, 1.0, 0.0, 0.0):
        step(force)
    monkeypatch.setattr(StandingScore, "fallen", fallen)
    step(0.0)
    step(1.0)
    assert (record.drops, record.lost) == (drops, drops)
    assert record.grip is not None


def test_a_light_grip_bruises_nothing_and_a_hard_one_does(open_cell, probe_of, pick_with):
    cell = open_cell(seed=9, fruit="apple_5", mass="85 g")
    probe = probe_of(cell)
    pick_with(probe)
    truth = cell.truth()
    assert truth["bruised"] == 0
    assert 0.05 < truth["largest_press"] < 1.0
    assert truth["pressed"] in ("apple_5 by pad_left", "apple_5 by pad_right")
    probe.force_wanted = 7.0  # 5.0 N bruise a fruit of 62 mm
    for _ in range(100):
        cell.clock.advance(0.02)
    assert cell.truth()["bruised"] == 1
