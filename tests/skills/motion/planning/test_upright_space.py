"""A load that stays upright, on a wrist of two crossed axes whose tilt is known in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pomona.skills.motion.planning.arm_space import COST, SLACK, STEP, UprightSpace, _Tree

MOST = 0.6
DISC = 0.15


class Wrist:
    """Two axes that cross: about x, then about the turned y; the tool points along z at rest."""

    gear = 1.0

    def tcp(self, q: np.ndarray) -> np.ndarray:
        (sin_a, sin_b), (cos_a, cos_b) = np.sin(self.gear * q), np.cos(self.gear * q)
        T = np.eye(4)
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_a, -sin_a], [0.0, sin_a, cos_a]])
        about_y = np.array([[cos_b, 0.0, sin_b], [0.0, 1.0, 0.0], [-sin_b, 0.0, cos_b]])
        T[:3, :3] = about_x @ about_y
        return T

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        J = np.zeros((6, 2))
        J[3:, 0] = 1.0, 0.0, 0.0
        J[3:, 1] = 0.0, np.cos(self.gear * q[0]), np.sin(self.gear * q[0])
        return self.gear * J


class Around:
    """The other constraints: a disc around the upright posture is blocked."""

    def __init__(self, disc: float = 0.0, most: float = 3.0) -> None:
        self.disc = disc
        self.lower, self.upper = np.full(2, -most), np.full(2, most)
        self.endless = np.array([False, True])
        self.world = SimpleNamespace(shape=SimpleNamespace(model=Wrist()))

    def free(self, q: np.ndarray) -> bool:
        return bool(np.linalg.norm(q) >= self.disc)

    def free_between(self, q_a: np.ndarray, q_b: np.ndarray) -> bool:
        return all(self.free(q_a + share * (q_b - q_a)) for share in np.linspace(0.0, 1.0, 21))

    def first_blocked(self, path: np.ndarray) -> int | None:
        blocked = (k for k in range(len(path) - 1) if not self.free_between(path[k], path[k + 1]))
        return next(blocked, None)

    def explain(self, q: np.ndarray) -> tuple[str, dict[str, object]]:
        return "the disc", {}


def upright(disc: float = 0.0, most: float = MOST, up: Any = (0.0, 0.0, 1.0)) -> UprightSpace:
    return UprightSpace(Around(disc), np.array(up), most)  # type: ignore[arg-type]


def tilt(q: Any) -> float:
    """The tilt in closed form: cos a cos b is the tool's height over its length."""
    return float(np.arccos(np.cos(q[0]) * np.cos(q[1])))


@pytest.mark.parametrize("q", [(0.0, 0.0), (0.4, 0.0), (0.0, -0.5), (0.3, 0.4), (2.0, 1.0)])
def test_the_tilt_is_that_of_the_loads_up(q: tuple[float, float]) -> None:
    assert upright().tilt(np.array(q)) == pytest.approx(tilt(q), abs=1e-9)
    assert upright(up=(0.0, 0.0, -1.0)).tilt(np.array(q)) == pytest.approx(np.pi - tilt(q))


@pytest.mark.parametrize(("up", "tilted"), [(1.0 + 1e-12, 0.0), (-1.0 - 1e-12, np.pi)])
def test_a_rounded_direction_has_a_tilt(up: float, tilted: float) -> None:
    assert upright(up=(0.0, 0.0, up)).tilt(np.zeros(2)) == tilted


def test_the_bound_itself_is_kept() -> None:
    q = np.array([0.3, 0.4])
    space = upright(most=upright().tilt(q))
    assert space.free(q)
    assert space._pulled_back(q) is q
    assert not space._tilted_between(np.zeros(2), q, 0.0)
    assert not space._tilted_between(q, np.zeros(2), 0.0)


def test_limits_are_those_of_the_arm() -> None:
    space = upright()
    assert space.lower is space.space.lower
    assert space.upper is space.space.upper
    assert space.endless is space.space.endless


def test_a_posture_is_free_within_the_bound_and_off_the_disc() -> None:
    space = upright(DISC)
    assert space.free(np.array([MOST - 1e-6, 0.0]))
    assert not space.free(np.array([MOST + 1e-6, 0.0]))
    assert not space.free(np.array([0.1, 0.0]))


def test_a_reason_names_what_is_broken() -> None:
    space = upright(DISC)
    assert space.explain(np.array([0.1, 0.0])) == ("the disc", {})
    words, data = space.explain(np.array([1.0, 0.0]))
    assert words == "the held fruit would be tilted by 57°, 34° are allowed"
    assert data == {"tilt_rad": pytest.approx(1.0), "allowed_rad": MOST}


def test_a_segment_between_free_ends_is_blocked_where_its_middle_tilts() -> None:
    space = upright(most=0.3)
    turned = np.array([2.0 * np.pi, 0.0])  # a whole turn: upright at both ends
    assert not space.free_between(np.zeros(2), turned)
    assert space.free_between(np.array([-0.29, 0.0]), np.array([0.29, 0.0]))
    assert not space.free_between(np.array([0.0, 0.0]), np.array([0.31, 0.0]))
    assert not upright(DISC).free_between(np.array([-0.3, 0.0]), np.array([0.3, 0.0]))


def test_segments_are_judged_as_samples_of_them_are() -> None:
    rng = np.random.default_rng(1)
    space = upright(most=0.5)
    judged = {True: 0, False: 0}
    for q_a, q_b in rng.uniform(-0.6, 0.6, (80, 2, 2)):
        largest = max(tilt(q_a + share * (q_b - q_a)) for share in np.linspace(0.0, 1.0, 100))
        if abs(largest - 0.5) < SLACK:
            continue
        tilted = space._tilted_between(q_a, q_b, 0.0)
        assert tilted is (largest > 0.5)
        judged[tilted] += 1
    assert min(judged.values()) > 12


def test_the_first_blocked_segment_is_of_the_tilt_or_of_the_disc_whichever_comes_first() -> None:
    space = upright(DISC)
    aside = np.array([0.3, 0.3])
    path = np.array([aside, [0.3, 0.31], [0.9, 0.3], [0.3, 0.3], -aside])
    assert space.first_blocked(path) == 1  # it tilts before it meets the disc
    assert space.first_blocked(path[3:]) == 0  # through the disc
    assert space.first_blocked(path[:2]) is None
    a_little = np.array([aside, [MOST + 0.5 * SLACK, 0.0]])
    assert space.first_blocked(a_little) is None  # a path before its execution has the tolerance
    assert space.first_blocked(np.array([aside, [MOST + 2.0 * SLACK, 0.0]])) == 0


def test_a_tilted_posture_is_pulled_back_along_the_shortest_way() -> None:
    space = upright()
    here = np.array([0.2, -0.1])
    assert space._pulled_back(here) is here
    back = space._pulled_back(np.array([1.0, 0.0]))
    np.testing.assert_allclose(back, [0.7 * MOST, 0.0], atol=1e-6)
    space.space.world.shape.model.gear = 2.0
    back = space._pulled_back(np.array([0.5, 0.0]))
    np.testing.assert_allclose(back, [0.35 * MOST, 0.0], atol=1e-6)
    space.space.world.shape.model.gear = 1.0
    slanting = space._pulled_back(np.array([0.7, 0.7]))
    assert slanting is not None
    assert 0.5 * MOST < tilt(slanting) <= MOST
    assert abs(slanting[0] - slanting[1]) < 0.1


def test_what_cannot_be_pulled_back_is_left() -> None:
    assert upright()._pulled_back(np.array([np.pi, 0.0])) is None  # upside down
    space = UprightSpace(Around(), np.array([0.0, 0.0, 1.0]), MOST)  # type: ignore[arg-type]
    space.space.lower[:] = 1.2  # limits that keep it tilted
    assert space._pulled_back(np.array([1.5, 1.5])) is None


def test_a_tree_grows_straight_to_a_posture_by_steps() -> None:
    tree = _Tree([np.array([1.0, 0.0]), np.array([0.1, 0.2])], [-1, -1])
    reached = upright(most=3.0)._grow(tree, np.array([0.1, 1.0]))
    assert (reached, tree.parents) == (4, [-1, -1, 1, 2, 3])
    np.testing.assert_allclose(tree.nodes[2:], [[0.1, 0.5], [0.1, 0.8], [0.1, 1.0]])
    assert upright(most=3.0)._grow(tree, np.array([0.1, 1.0])) == reached  # it is there


def test_a_tree_ends_where_the_bound_or_an_obstacle_does() -> None:
    tree = _Tree([np.zeros(2)], [-1])
    reached = upright()._grow(tree, np.array([2.0, 0.0]))
    assert 0.5 * MOST < tree.nodes[reached][0] <= MOST
    assert len(tree.nodes) < 6  # no creeping along the bound
    tree = _Tree([np.array([-0.5, 0.0])], [-1])
    assert upright(DISC)._grow(tree, np.array([0.5, 0.0])) == 1
    np.testing.assert_allclose(tree.nodes[1], [-0.2, 0.0])


@pytest.mark.parametrize("seed", range(1, 10))
def test_a_way_around_the_disc_keeps_the_bound(seed: int) -> None:
    space = upright(DISC)
    start, goals = np.array([-0.5, -0.1]), np.array([[2.0, 2.0], [0.5, 0.1]])
    way, used = space.connect(start, goals, 4000, seed)
    assert way is not None
    np.testing.assert_array_equal(way[0], start)
    np.testing.assert_array_equal(way[-1], goals[1])  # the other one cannot be reached
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    assert steps.max() <= STEP + 1e-9
    assert steps.min() > 0.0
    assert space.first_blocked(way) is None
    assert used % COST == 0
    assert COST <= used <= 4000
    again, _ = space.connect(start, goals, 4000, seed)
    np.testing.assert_array_equal(again, way)


def test_a_search_ends_with_its_iterations() -> None:
    walled = upright(0.3)
    walled.space.free_between = lambda q_a, q_b: False  # type: ignore[method-assign]
    assert walled.connect(np.array([-0.5, 0.0]), np.array([[0.5, 0.0]]), 10 * COST + 7, 1) == (
        None,
        10 * COST,
    )
    assert walled.connect(np.array([-0.5, 0.0]), np.array([[0.5, 0.0]]), 3, 1) == (None, COST)
