"""The distances by which a description is judged are those of the arm, however its frames are written."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.universal_robots.options import LENGTHS
from pomona.devices.xarm.options import LENGTHS as XARMS
from pomona.drivers.described_arm import DOUBT, OFF, axis_distances, other_model

ROBOTS = Path(__file__).resolve().parents[2] / "trees" / "robots"


def apart(one: Sequence[float], other: Sequence[float]) -> float:
    """The largest difference of a distance [m]; of different numbers of joints without end."""
    return float(np.abs(np.subtract(one, other)).max()) if len(one) == len(other) else np.inf


@pytest.mark.parametrize(
    ("name", "lengths", "model"),
    [
        ("ur5e_wsg32.xml", LENGTHS, "ur5e"),
        ("ur5e_hand_e.xml", LENGTHS, "ur5e"),
        ("ur5e_hand_e.xml", LENGTHS, "ur5"),
        ("xarm6_hand_e.xml", XARMS, "xarm6"),
    ],
)
def test_a_shipped_description_is_that_of_its_model_alone(
    name: str, lengths: dict, model: str
) -> None:
    assert list(other_model(ROBOTS / name, lengths, model)) == []
    others = [other for other, of in lengths.items() if apart(of, lengths[model]) > OFF]
    assert others
    for other in others:
        (problem,) = other_model(ROBOTS / name, lengths, other)
        assert problem.key == "robot"
        assert not problem.warning


def test_a_model_without_known_lengths_is_not_compared() -> None:
    assert list(other_model(ROBOTS / "xarm6_hand_e.xml", LENGTHS, "ur18")) == []


@pytest.mark.parametrize("lengths", [LENGTHS, XARMS])
def test_models_differ_by_far_more_than_the_tolerance_or_not_at_all(lengths: dict) -> None:
    for (one, of), (other, of_other) in itertools.combinations(lengths.items(), 2):
        if {one, other} == {"ur15", "ur30"}:
            assert DOUBT < apart(of, of_other) < OFF
        else:
            assert apart(of, of_other) < 0.001 or apart(of, of_other) > 2.5 * OFF


def arm_of(folder: Path, dh: list[tuple[float, float, float]], rng: np.random.Generator) -> Path:
    """An arm of (a, alpha, d) whose frames lie anywhere along their axes, turned at random, in a random posture."""
    T, places = np.eye(4), []
    for a, alpha, d in dh:
        places.append(T)
        theta = rng.uniform(-np.pi, np.pi)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        T = T @ np.array(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    bodies, before = "", np.eye(4)
    for i, place in enumerate(places):
        along = np.eye(4)
        along[2, 3] = rng.uniform(-0.3, 0.3)
        x, y, _, position = (np.linalg.inv(before) @ place @ along)[:3].T
        pos, axes = (" ".join(f"{v:.9f}" for v in numbers) for numbers in (position, (*x, *y)))
        bodies += f'<body pos="{pos}" xyaxes="{axes}"><joint name="j{i}" range="-3 3"/><geom size="0.01"/>'
        before = place @ along
    motors = "".join(f'<motor joint="j{i}"/>' for i in range(len(dh)))
    path = folder / "arm.xml"
    path.write_text(
        f"<mujoco><worldbody>{bodies}{'</body>' * len(dh)}</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    return path


@pytest.mark.parametrize("seed", range(5))
def test_neither_frames_nor_posture_change_the_distances(tmp_path: Path, seed: int) -> None:
    right = np.pi / 2.0
    links = [
        (0, right, 0.1807),
        (-0.6127, 0, 0),
        (-0.57155, 0, 0.17415),
        (0, right, 0.11985),
        (0, -right, 0.11655),
    ]
    path = arm_of(tmp_path, [*links, (0, 0, 0)], np.random.default_rng(seed))
    assert axis_distances(path, 6) == pytest.approx(LENGTHS["ur10e"], abs=1e-6)


@pytest.mark.parametrize(("longer", "found"), [(0.005, []), (0.015, [True]), (0.03, [False])])
def test_a_calibrated_arm_passes_a_doubtful_one_is_a_warning(
    tmp_path: Path, longer: float, found: list[bool]
) -> None:
    right = np.pi / 2.0
    links = [
        (0, right, 0.16),
        (-0.425 - longer, 0.001, 0),
        (-0.3922, -0.001, 0.13),
        (0, right, 0.1),
        (0, -right, 0.1),
    ]
    path = arm_of(tmp_path, [*links, (0, 0, 0)], np.random.default_rng(1))
    assert [problem.warning for problem in other_model(path, LENGTHS, "ur5e")] == found
