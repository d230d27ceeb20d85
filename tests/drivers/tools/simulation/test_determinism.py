"""The same seed gives the same bits; another seed gives another world."""

import numpy as np

from pomona.drivers.interfaces import Camera


def story(open_cell, probe_of, pick_with, seed):
    """Sensor data and joints of a whole pick."""
    cell = open_cell(seed=seed, fruit="apple_4", others="1", distractors="2")
    frame = cell.device(Camera).latest()
    probe = probe_of(cell)
    pick_with(probe)
    last = cell.device(Camera).latest()
    wrenches = np.array([sample.wrenches for sample in probe.samples])
    truth = {name: value for name, value in cell.truth().items() if name != "fruits"}
    return frame, last, wrenches, cell.devices["world"].state.qpos.copy(), truth


def test_the_same_seed_gives_bit_identical_data_and_motion(open_cell, probe_of, pick_with):
    one = story(open_cell, probe_of, pick_with, seed=7)
    two = story(open_cell, probe_of, pick_with, seed=7)
    for a, b in ((one[0], two[0]), (one[1], two[1])):
        assert np.array_equal(a.colour, b.colour)
        assert np.array_equal(a.depth, b.depth)
        assert a.stamp == b.stamp
    assert np.array_equal(one[2], two[2])
    assert np.array_equal(one[3], two[3])
    assert one[4] == two[4]


def test_another_seed_gives_another_world(open_cell):
    frames = [open_cell(seed=seed).device(Camera).latest() for seed in (1, 2)]
    assert not np.array_equal(frames[0].colour, frames[1].colour)
    truths = [open_cell(seed=seed).truth() for seed in (1, 2)]
    assert truths[0]["mass_kg"] != truths[1]["mass_kg"]
    assert truths[0]["friction"] != truths[1]["friction"]


def test_looking_does_not_change_the_motion(open_cell):
    looked, blind = open_cell(seed=5), open_cell(seed=5)
    for _ in range(20):
        looked.clock.advance(0.02)
        looked.device(Camera).latest()
        blind.clock.advance(0.02)
    assert np.array_equal(looked.devices["world"].state.qpos, blind.devices["world"].state.qpos)
