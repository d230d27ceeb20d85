"""Friction found again from pushes on a LuGre contact that shares no code with the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from pomona.drivers.interfaces import WrenchSample
from pomona.skills.grip.limit_surface import SoftContact
from pomona.tools.grip_calibration.calibration import (
    Push,
    PushRecorder,
    TooFewPushes,
    calibrate_grip,
    write_calibration,
)
from tests.skills.tools.grip_calibration.pushes import TRUE, all_pushes, middle


def test_friction_and_stiffness_are_found_again() -> None:
    pushes, squeeze = all_pushes()
    found = calibrate_grip(list(pushes), squeeze)
    assert found.contact.mu == pytest.approx(TRUE.mu, rel=0.05)
    assert found.contact.torsion * 2.0**TRUE.gamma == pytest.approx(
        TRUE.torsion * 2.0**TRUE.gamma, rel=0.10
    )
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


def test_the_file_holds_pads_and_quality(tmp_path: Path) -> None:
    pushes, squeeze = all_pushes()
    write_calibration(calibrate_grip(list(pushes), squeeze), tmp_path / "apple.yaml", "apple")
    written = yaml.safe_load((tmp_path / "apple.yaml").read_text())
    assert middle(written["pads"]["friction"]["any"]) == pytest.approx(TRUE.mu, rel=0.05)
    assert written["pads"]["delta"].endswith(" mm")
    assert written["quality"]["relative_residual"] < 0.05
    assert written["quality"]["notes"] == []


def test_a_live_stream_becomes_a_push_without_its_bias() -> None:
    recorder = PushRecorder(width=lambda: 0.07)
    for i in range(150):
        wrenches = np.full((2, 6), 0.1)
        wrenches[:, 2] -= 1.0 if i >= 100 else 0.0
        assert recorder.ready == (i >= 100)
        recorder.on_sample(WrenchSample(0.002 * i, i, wrenches, (False, i == 120)))
    push = recorder.push()
    assert push.wrenches.shape == (49, 2, 6)
    assert push.wrenches[:, :, 2] == pytest.approx(np.full((49, 2), -1.0))
    assert push.wrenches[:, :, 0] == pytest.approx(np.zeros((49, 2)))
    assert (push.width == 0.07).all()
    with pytest.raises(TooFewPushes):
        PushRecorder().push()


def test_one_twist_does_not_show_how_the_contact_grows_and_no_contact_is_larger_than_the_pads() -> (
    None
):
    def slide(f_n: float, f_t: float, tau_n: float) -> Push:
        wrenches = np.zeros((500, 2, 6))
        wrenches[:, :, 2] = -f_n
        wrenches[:, :, 0] = f_t
        wrenches[:, 0, 5], wrenches[:, 1, 5] = tau_n, -tau_n
        return Push(wrenches, np.full(500, np.nan))

    pushes = [slide(f, 0.6 * f, 0.0) for f in (1.0, 2.0, 3.5)]
    pushes += [slide(1.0, 0.2, 0.012), slide(2.0, 1.1, 0.003), slide(3.5, 1.95, 0.004)]
    found = calibrate_grip(pushes)
    assert found.contact.mu == pytest.approx(0.6, rel=0.1)
    assert abs(found.contact.gamma - SoftContact().gamma) < 0.3
    assert found.contact.delta < 0.012
    assert any("larger than the pads" in note for note in found.notes)
