"""The DetectAll skill: every fruit of a frame, and every way in which it fails."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Camera, Frame, Intrinsics
from pomona.executive.clock import ManualClock
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.detect_all import DetectAll
from pomona.skills.geometry import transform
from pomona.skills.perception.detection.errors import BadFrame
from pomona.skills.perception.detection.instances import Instance
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.shared import looking

FRAME = Frame(
    0.0, 0, np.zeros((48, 64, 3), np.uint8), None, Intrinsics(61.0, 61.0, 31.5, 23.5, 64, 48), None, np.eye(4), "look"
)  # fmt: skip


@dataclass
class OneFrame:
    """A camera that shows one frame."""

    frame: Frame | None

    def latest(self) -> Frame | None:
        return self.frame


def instance(score: float, posed: bool = True) -> Instance:
    points = np.full((9, 2), 20.0)
    if not posed:
        return Instance(points, score, 1.0, None, None, "the keypoints lie on a line")
    return Instance(points, score, 1.0, transform(None, (0.0, 0.0, 0.5)), np.eye(6) * 1e-4)


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> list[Instance]:
    """Script the detector's output, instead of running networks."""
    instances: list[Instance] = []
    monkeypatch.setattr(looking, "find_in_frame", lambda _frame, _fruit, _options: list(instances))
    apple = replace(load_fruit("apple"), weights=Path("apple.weights"))
    monkeypatch.setattr(
        looking, "load_fruit", lambda name: apple if name == "apple" else load_fruit(name)
    )
    return instances


def look(frame: Frame | None = FRAME, now: float = 0.0, **inputs: Any) -> SkillEnd:
    return drive(
        DetectAll(), {"fruit": "apple", **inputs}, {Camera: OneFrame(frame)}, clock=ManualClock(now)
    )


def test_all_that_are_sure_and_posed_come_by_falling_score(scripted: list[Instance]) -> None:
    scripted += [instance(0.95), instance(0.9, posed=False), instance(0.8), instance(0.3)]
    outcome = look()
    assert outcome.status is Status.SUCCESS
    found = outcome.outputs["all"]
    assert [(d.score, d.index, d.found) for d in found.detections] == [(0.95, 0, 2), (0.8, 1, 2)]
    assert found.sentence == "2 fruit found in look"
    assert outcome.published[0][0] == "detection"
    assert (
        outcome.published[0][1].caption == "3 found"
    )  # without a target, and without a comma for it


@pytest.mark.parametrize(
    ("frame", "now", "inputs", "code"),
    [
        (None, 0.0, {}, "NO_FRAME"),
        (FRAME, 3.0, {}, "STALE_FRAME"),
        (FRAME, 0.0, {"score": 0.99}, "NOTHING_FOUND"),
        (FRAME, 0.0, {"fruit": "durian"}, "NO_WEIGHTS"),
    ],
)
def test_failures_have_their_codes(scripted, frame, now, inputs, code) -> None:
    scripted += [instance(0.95)]
    outcome = look(frame, now, **inputs)
    assert outcome.status is Status.FAILURE
    assert outcome.reason is not None
    assert outcome.reason.code == code
    assert outcome.outputs == {}


def test_a_frame_that_cannot_be_used_is_no_frame(
    monkeypatch: pytest.MonkeyPatch, scripted: list[Instance]
) -> None:
    def refuse(*_: object) -> list[Instance]:
        raise BadFrame("(h, w, 3) uint8 RGB", "(480, 640) float64")

    monkeypatch.setattr(looking, "find_in_frame", refuse)
    outcome = look()
    assert outcome.reason is not None
    assert outcome.reason.code == "NO_FRAME"


def test_interrupted_it_gives_up(scripted: list[Instance]) -> None:
    scripted += [instance(0.95)]
    outcome = drive(
        DetectAll(), {"fruit": "apple"}, {Camera: OneFrame(FRAME)}, computing=10, interrupt_after=5
    )
    assert outcome.status is Status.INVALID
    assert outcome.cancelled == 1
    assert outcome.outputs == {}
