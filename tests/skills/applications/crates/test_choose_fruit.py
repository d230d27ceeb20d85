from dataclasses import replace

import numpy as np
from py_trees.common import Status

from pomona.applications.crates.choose_fruit import MOVES, ChooseFruit
from pomona.applications.crates.fruit_scene import FruitScene, SeenFruit
from pomona.drivers.interfaces import Arm, Workspace
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.executive.views import TableView
from pomona.skills.perception.detection.detection import Detection
from pomona.skills.perception.measured_fruit import MeasuredFruit
from tests.skills.picking_scene import WORKSPACE, PickingScene, apple_at

ROW = [(-0.092, 0.0), (0.0, 0.0), (0.092, 0.0), (0.0, 0.092), (0.0, -0.092)]
"""A cross of five apples of 89 mm about its second one [m]."""


def seen(x: float, y: float, failed: bool = False) -> SeenFruit:
    """An apple at a place about (-0.03, -0.52) on the table [m]."""
    made = apple_at(1, 3)
    T_base_fruit = made.T_base_fruit.copy()
    T_base_fruit[:2, 3] += [x, y]
    measured = replace(made, T_base_fruit=T_base_fruit)
    detection = Detection(
        made.fruit,
        made.frame,
        np.eye(4),
        T_base_fruit,
        np.zeros((9, 2)),
        0.9,
        np.eye(6) * 1e-6,
        0,
        1,
    )
    return SeenFruit(detection, None, "no depth") if failed else SeenFruit(detection, measured)


def scene(*places: tuple[float, float]) -> FruitScene:
    return FruitScene(tuple(seen(*place) for place in places))


def choose(skill: ChooseFruit, fruit: FruitScene, **inputs: object) -> SkillEnd:
    bench = PickingScene()
    devices = {Arm: bench.arm, Workspace: replace(WORKSPACE, obstacles=())}
    return drive(skill, {"scene": fruit, **inputs}, devices, clock=bench.clock)


def place(outcome: SkillEnd) -> list[float]:
    measured: MeasuredFruit = outcome.outputs["measured"]
    return [
        round(float(v), 3)
        for v in measured.T_base_fruit[:2, 3] - apple_at(1, 3).T_base_fruit[:2, 3]
    ]


def test_the_freest_fruit_is_chosen_with_all_others_beside_it():
    outcome = choose(ChooseFruit(), scene(ROW[1], *ROW[2:], ROW[0], (0.3, 0.0)))
    assert outcome.status is Status.SUCCESS
    assert place(outcome) == [0.3, 0.0]
    assert len(outcome.outputs["measured"].beside) == 5
    assert (
        outcome.outputs["detection"].T_camera_object[0, 3]
        == outcome.outputs["measured"].T_base_fruit[0, 3]
    )
    topic, table = outcome.published[0]
    assert topic == "choice"
    assert isinstance(table, TableView)
    assert len(table.rows) == 6


def test_a_fruit_in_the_middle_comes_last():
    skill, order = ChooseFruit(), list(ROW)
    taken = []
    while order:
        where = place(choose(skill, scene(*order)))
        taken.append(where)
        order = [p for p in order if not np.allclose(p, where, atol=1e-3)]
    assert taken.index([0.0, 0.0]) >= 2


def test_nearest_to_the_camera_is_the_other_order():
    outcome = choose(ChooseFruit(), scene((0.3, 0.0), (0.0, 0.1), (0.1, -0.2)), target="nearest")
    assert place(outcome) == [0.0, 0.1]


def test_a_fruit_is_tried_twice_and_again_when_a_neighbour_has_gone():
    skill, fruit = ChooseFruit(), scene((0.0, 0.0), (0.1, 0.0))
    chosen = [place(choose(skill, fruit)) for _ in range(4)]
    assert sorted(map(tuple, chosen)) == [(0.0, 0.0)] * 2 + [(0.1, 0.0)] * 2
    outcome = choose(skill, fruit)
    assert outcome.reason.code == "NOTHING_LEFT"
    assert outcome.reason.data["left"] == 2
    alone = scene((0.0, 0.0))
    assert place(choose(skill, alone)) == [0.0, 0.0]
    assert place(choose(skill, alone)) == [0.0, 0.0]
    assert choose(skill, alone).reason.code == "NOTHING_LEFT"


def test_a_fruit_that_was_drawn_from_a_wall_is_tried_again_a_bounded_number_of_times():
    skill = ChooseFruit()
    for step in range(1 + MOVES):
        x = 0.02 * (step % 2)  # nearer than the next fruit would be
        assert place(choose(skill, scene((x, 0.0)), tries=1)) == [x, 0.0]
        assert (
            choose(skill, scene((x + 0.003, 0.0)), tries=1).reason.code == "NOTHING_LEFT"
        )  # an error of the look
    assert choose(skill, scene((0.0, 0.0)), tries=1).reason.code == "NOTHING_LEFT"


def test_a_fruit_that_was_not_measured_is_not_chosen_and_counts_as_neighbour():
    skill = ChooseFruit()
    hidden = FruitScene((seen(0.0, 0.0), seen(0.1, 0.0, failed=True)))
    assert place(choose(skill, hidden, tries=1)) == [0.0, 0.0]
    assert choose(skill, hidden, tries=1).reason.code == "NOTHING_LEFT"
    assert place(choose(skill, scene((0.0, 0.0)), tries=1)) == [0.0, 0.0]


def test_interrupted_it_has_chosen_nothing():
    bench, skill = PickingScene(), ChooseFruit()
    devices = {Arm: bench.arm, Workspace: WORKSPACE}
    fruit = {"scene": scene((0.0, 0.0)), "tries": 1}
    outcome = drive(skill, fruit, devices, clock=bench.clock, computing=10, interrupt_after=5)
    assert outcome.status is Status.INVALID
    assert drive(skill, fruit, devices, clock=bench.clock).status is Status.SUCCESS
