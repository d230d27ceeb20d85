"""The score's least force is where the engine itself lets a held fruit slip."""

import pytest

from drivers.sim.fingers import SimFingers


@pytest.mark.parametrize("friction", ["0.5", "0.9"])
def test_slip_begins_at_the_least_force(open_cell, probe_of, pick_with, friction):
    cell = open_cell(seed=9, fruit="apple_1", friction=friction, mass="200 g")
    probe = probe_of(cell)
    pick_with(probe)
    assert cell.truth()["lifted"] is True
    exact = SimFingers(probe.world, noise=0.0, bias=0.0, force_range=100.0)
    least = probe.world.score._least_force()
    assert least >= 0.99 * 0.2 * 9.81 / float(friction)  # a twist of the fruit only adds to its weight
    slips, pressed, loads = [cell.truth()["slip_mm"]], [0.0], [least]
    while len(slips) < 3 or slips[-1] < slips[-2] + 0.02:  # ease the grip slowly until it slips by 1 mm/s
        probe.force_wanted -= 0.001
        cell.clock.advance(0.02)
        slips.append(cell.truth()["slip_mm"])
        pressed.append(float(-exact.latest().wrenches[:, 2].sum()))
        loads.append(probe.world.score._least_force())
        assert probe.force_wanted > 0.0
    # Several points of contact resist a twist a little better than the one of the ellipsoid.
    assert 0.94 < pressed[-2] / loads[-2] < 1.01
