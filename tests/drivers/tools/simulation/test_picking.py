"""Physics decides: friction lifts the fruit, and too little of it does not."""

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault


@pytest.mark.parametrize(("fruit", "place"), [("apple_3", "3"), ("apple_5", "5")])
def test_a_scripted_probe_picks_the_fruit(open_cell, probe_of, pick_with, fruit, place):
    cell = open_cell(seed=3, fruit=fruit, place=place)
    pick_with(probe_of(cell))
    truth = cell.truth()
    assert truth["lifted"] is True
    assert truth["fruit"] == fruit
    assert truth["height_gained_m"] == pytest.approx(0.12, abs=0.003)
    assert truth["slip_mm"] < 0.5
    assert truth["rotation_deg"] < 1.0
    assert truth["drops"] == truth["lost"] == 0
    assert truth["collisions"] == 0
    assert truth["least_force_n"] < truth["peak_force_n"]
    # The minimum grip force is what friction needs for the weight, a little more while accelerating upwards.
    needed = truth["mass_kg"] * 9.81 / truth["friction"]
    assert needed < truth["least_force_n"] < 1.35 * needed


def test_too_little_force_leaves_the_fruit_on_the_table(open_cell, probe_of, pick_with):
    cell = open_cell(seed=3, fruit="apple_1", friction="0.5", mass="300 g")
    pick_with(probe_of(cell), force=1.5)  # friction holds 2 · 1.5 · 0.5 = 1.5 N of 2.9 N
    truth = cell.truth()
    assert truth["lifted"] is False
    assert truth["height_gained_m"] < 0.01
    assert truth["slip_mm"] > 5.0
    assert truth["drops"] == 0  # it never hung, so it did not fall,
    assert truth["lost"] == 1  # and slid out of the grip all the same


def test_a_fruit_that_hangs_falls_when_the_fingers_open(open_cell, probe_of, pick_with):
    cell = open_cell(seed=4, fruit="apple_4")
    probe = probe_of(cell)
    pick_with(probe)
    assert cell.truth()["lifted"] is True
    probe.let_go()
    probe.run(probe.gripper.move(0.10, 0.2))
    truth = cell.truth()
    assert truth["lifted"] is False
    assert truth["drops"] == truth["lost"] == 1


def test_touching_the_table_is_counted_as_a_collision(open_cell, probe_of):
    cell = open_cell(seed=1, place="1")
    probe = probe_of(cell)
    probe.go_down_to([-0.03, -0.50, -0.112])  # the fingertips reach 12 mm below the tool's centre
    end = cell.clock.now() + 3.0
    probe.wait(lambda: cell.clock.now() >= end)
    truth = cell.truth()
    assert truth["collisions"] >= 1
    assert truth["collided_with"] == ["table"]


def test_a_fruit_that_stands_in_the_crate_is_put_away_and_not_dropped(
    open_cell, probe_of, pick_with
):
    cell = open_cell(seed=4, fruit="apple_4")
    world = probe_of(cell).world
    before = world.truth()
    assert before["put_away"] == 0
    world.state.joint("fruit_0").qpos[:3] = [0.395, 0.045, -0.07]
    cell.clock.advance(1.0)
    world.looked()
    truth = world.truth()
    assert truth["put_away"] == 1
    assert truth["T_base_fruit_at_look"] == before["T_base_fruit_at_look"], (
        "a fruit in the crate is not measured"
    )
    assert truth["fruits"][0]["inside"] == "crate"
    assert truth["drops"] == 0
    assert (
        abs(truth["fruits"][0]["T_base_fruit"][2][3] - (-0.112 + 0.032)) < 0.004
    )  # on the floor, 8 mm thick


def test_touching_a_fixed_object_is_counted_as_a_collision(open_cell, probe_of, plan_rest_to_rest):
    cell = open_cell(seed=1, place="1")
    probe = probe_of(cell)
    above = [-0.618, 0.363, 0.493, -0.447, 0.233, -0.814, -0.009]
    onto_the_wall = [-0.466, 0.681, 0.319, -0.472, 0.44, -0.483, -0.18]
    way = np.array([probe.set_point(), above, onto_the_wall])
    probe.arm.follow(plan_rest_to_rest(way, probe.arm.limits))
    with pytest.raises(
        DeviceFault, match="gripper: closes without a command"
    ):  # the wall pushes a finger
        probe.wait(lambda: False, 6.0)
    cell.clock.advance(2.0)
    assert cell.truth()["collided_with"] == ["crate"]
