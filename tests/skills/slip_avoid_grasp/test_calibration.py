"""Friction found again from pushes on a LuGre contact that shares no code with the fit."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.grasp_patch import Fruit, PatchGrasp
from drivers.interfaces import WrenchSample
from skills.slip_avoid_grasp.calibration import (
    Push,
    PushRecorder,
    calibrate_grip,
    read_pushes,
    write_calibration,
    write_pushes,
)
from skills.slip_avoid_grasp.errors import TooFewPushes
from skills.slip_avoid_grasp.limit_surface import SoftContact

TRUE = SoftContact(mu=0.55, delta=0.0050, gamma=0.30)


def push(lever: float, force: float, seed: int = 0, noise: float = 0.05) -> tuple[Push, Push]:
    """Squeeze a fruit slowly up to a grasp force, then pull it down until it slides: (squeeze, push)."""
    fruit = Fruit(mass=0.05, mu=TRUE.mu, delta=TRUE.delta, gamma=TRUE.gamma, offset=(lever, 0.0))
    grasp = PatchGrasp(fruit)
    rng = np.random.default_rng(seed)
    wrenches, widths, squeezed = [], [], 0
    for i in range(6000):
        true = grasp.step()
        wrenches.append(true + rng.normal(0.0, noise, (2, 6)) * [1, 1, 1, 0.005, 0.005, 0.005])
        widths.append(grasp.width)
        if squeezed == 0:
            grasp.command = -0.024 if grasp.f_n == 0.0 else -0.004
            if grasp.f_n >= force:
                squeezed, grasp.command = i, 0.0
        else:
            grasp.climb = 0.02 if i < squeezed + 500 and grasp.height < 0.01 else 0.0
            if grasp.climb == 0.0:
                grasp.pull = (0.0, grasp.pull[1] - 0.004)
            if abs(grasp.place[1]) > 0.003 or abs(grasp.turn) > 0.3:
                break
    both, width = np.array(wrenches), np.array(widths)
    return Push(both[:squeezed], width[:squeezed]), Push(both[squeezed:], width[squeezed:])


@lru_cache(maxsize=1)
def all_pushes() -> tuple[tuple[Push, ...], Push]:
    tasks = [(0.0, 2.0), (0.0, 5.0), (0.008, 2.0), (0.008, 4.0), (0.008, 8.0), (0.015, 3.0), (0.015, 7.0)]
    made = [push(lever, force, seed) for seed, (lever, force) in enumerate(tasks)]
    return tuple(p for _, p in made), made[4][0]


def test_friction_and_stiffness_are_found_again() -> None:
    pushes, squeeze = all_pushes()
    found = calibrate_grip(list(pushes), squeeze)
    assert found.contact.mu == pytest.approx(TRUE.mu, rel=0.05)
    assert found.contact.torsion * 2.0**TRUE.gamma == pytest.approx(TRUE.torsion * 2.0**TRUE.gamma, rel=0.10)
    assert found.contact.gamma == pytest.approx(TRUE.gamma, abs=0.10)
    assert found.stiffness == pytest.approx(2000.0, rel=0.03)
    assert found.residual < 0.05
    assert found.notes == ()
    assert found.mu_std < 0.03


def test_straight_pushes_alone_leave_the_torsion_and_say_so() -> None:
    pushes, _ = all_pushes()
    found = calibrate_grip(list(pushes[:2]))
    assert found.contact.mu == pytest.approx(TRUE.mu, rel=0.05)
    assert found.contact.delta == SoftContact().delta
    assert found.stiffness is None
    assert "no push twisted" in found.notes[0]


def test_pushes_at_one_force_leave_gamma_and_say_so() -> None:
    pushes, _ = all_pushes()
    found = calibrate_grip([pushes[0], pushes[2], pushes[2]])
    assert found.contact.gamma == SoftContact().gamma
    assert "too close together" in found.notes[0]


def test_too_few_pushes_are_refused_in_words() -> None:
    with pytest.raises(TooFewPushes, match="hold the fruit with a steady force"):
        calibrate_grip([Push(np.zeros((500, 2, 6)), np.zeros(500))])


def test_the_file_holds_ports_and_quality(tmp_path: Path) -> None:
    pushes, squeeze = all_pushes()
    write_calibration(calibrate_grip(list(pushes), squeeze), tmp_path / "apple.yaml", "apple")
    written = yaml.safe_load((tmp_path / "apple.yaml").read_text())
    assert written["ports"]["mu"] == pytest.approx(TRUE.mu, rel=0.05)
    assert written["ports"]["delta"].endswith(" mm")
    assert written["quality"]["relative_residual"] < 0.05
    assert written["quality"]["notes"] == []


def test_pushes_survive_a_file(tmp_path: Path) -> None:
    pushes, _ = all_pushes()
    write_pushes(list(pushes[:2]), tmp_path / "pushes.npz")
    again = read_pushes(tmp_path / "pushes.npz")
    assert len(again) == 2
    assert np.array_equal(again[1].wrenches, pushes[1].wrenches)
    write_pushes([], tmp_path / "none.npz")
    with pytest.raises(TooFewPushes):
        read_pushes(tmp_path / "none.npz")


def test_a_live_stream_becomes_a_push_without_its_bias() -> None:
    recorder = PushRecorder(width=lambda: 0.07)
    for i in range(150):
        wrenches = np.full((2, 6), 0.1)
        wrenches[:, 2] -= 1.0 if i >= 100 else 0.0
        assert recorder.ready == (i >= 100)
        recorder.hear(WrenchSample(0.002 * i, i, wrenches, (False, i == 120)))
    push = recorder.push()
    assert push.wrenches.shape == (49, 2, 6)
    assert push.wrenches[:, :, 2] == pytest.approx(np.full((49, 2), -1.0))
    assert push.wrenches[:, :, 0] == pytest.approx(np.zeros((49, 2)))
    assert (push.width == 0.07).all()
    with pytest.raises(TooFewPushes):
        PushRecorder().push()
