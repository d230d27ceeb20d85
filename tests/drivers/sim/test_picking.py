"""Physics decides: friction lifts the fruit, and too little of it does not."""

import pytest


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
    assert truth["drops"] == 0
    assert truth["collisions"] == 0
    assert truth["least_force_n"] < truth["peak_force_n"]
    # The least force is what friction needs for the weight, a little more while accelerating upwards.
    needed = truth["mass_kg"] * 9.81 / truth["friction"]
    assert needed < truth["least_force_n"] < 1.35 * needed


def test_too_little_force_leaves_the_fruit_on_the_table(open_cell, probe_of, pick_with):
    cell = open_cell(seed=3, fruit="apple_1", friction="0.5", mass="300 g")
    pick_with(probe_of(cell), force=1.5)  # friction holds 2 · 1.5 · 0.5 = 1.5 N of 2.9 N
    truth = cell.truth()
    assert truth["lifted"] is False
    assert truth["height_gained_m"] < 0.01
    assert truth["slip_mm"] > 5.0


def test_a_fruit_that_hangs_falls_when_the_fingers_open(open_cell, probe_of, pick_with):
    cell = open_cell(seed=4, fruit="apple_4")
    probe = probe_of(cell)
    pick_with(probe)
    assert cell.truth()["lifted"] is True
    probe.let_go()
    probe.run(probe.gripper.move(0.10, 0.2))
    truth = cell.truth()
    assert truth["lifted"] is False
    assert truth["drops"] == 1


def test_touching_the_table_is_counted_as_a_collision(open_cell, probe_of):
    cell = open_cell(seed=1, place="1")
    probe = probe_of(cell)
    probe.go_down_to([-0.03, -0.50, -0.112])  # the fingertips reach 12 mm below the tool's centre
    end = cell.clock.now() + 3.0
    probe.wait(lambda: cell.clock.now() >= end)
    truth = cell.truth()
    assert truth["collisions"] >= 1
    assert truth["collided_with"] == ["table"]
