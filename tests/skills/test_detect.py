"""The Detect skill: outputs, choice of the target, and every way in which it fails."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Camera, Frame, Intrinsics
from pomona.executive.clock import ManualClock
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.detect import Detect
from pomona.skills.geometry import rotation_about, transform
from pomona.skills.perception.detection.detection import DetectorOptions, DopeFiles
from pomona.skills.perception.detection.errors import BadFrame
from pomona.skills.perception.detection.instances import Instance, cuboid_keypoints, rank
from pomona.skills.perception.fruit import FruitModel, catalogue, load_fruit
from pomona.skills.refine import Refine
from pomona.skills.shared import looking

INTRINSICS = Intrinsics(610.6, 610.6, 317.7, 238.1, 640, 480)
T_BASE_CAMERA = transform(rotation_about((1.0, 0.0, 0.0), np.pi), (0.0, -0.4, 0.6))


@dataclass
class OneFrame:
    """A camera that shows one frame."""

    frame: Frame | None

    def latest(self) -> Frame | None:
        return self.frame


def frame(stamp: float = 0.0, q: np.ndarray | None = None) -> Frame:
    return Frame(stamp, 0, np.zeros((480, 640, 3), np.uint8), None, INTRINSICS, q, T_BASE_CAMERA)


def instance(
    x: float, z: float, score: float = 0.9, visibility: float = 1.0, posed: bool = True
) -> Instance:
    T = transform(None, (x, 0.0, z))
    corners = cuboid_keypoints((0.09756, 0.08539, 0.09590)) + T[:3, 3]
    points = corners[:, :2] / corners[:, 2:] * (INTRINSICS.fx, INTRINSICS.fy) + (
        INTRINSICS.cx,
        INTRINSICS.cy,
    )
    if not posed:
        return Instance(
            points,
            score,
            visibility,
            None,
            None,
            "no pose follows from the keypoints: they lie on a line",
        )
    return Instance(points, score, visibility, T, np.eye(6) * 1e-4)


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> list[Instance]:
    """Script the detector's output, instead of running networks."""
    instances: list[Instance] = []
    monkeypatch.setattr(looking, "find_in_frame", lambda _frame, _fruit, _options: list(instances))
    apple = replace(load_fruit("apple"), weights=Path("apple.weights"))
    monkeypatch.setattr(
        looking, "load_fruit", lambda name: apple if name == "apple" else load_fruit(name)
    )
    return instances


def look(skill: Detect | None = None, shown: Frame | None = None, **inputs: Any) -> SkillEnd:
    camera = OneFrame(shown or frame())
    return drive(skill or Detect(), {"fruit": "apple", **inputs}, devices={Camera: camera})


def test_the_detection_holds_all_about_its_fruit(scripted: list[Instance]) -> None:
    scripted += [
        instance(0.1, 0.5, score=0.95),
        instance(-0.1, 0.4, score=0.8),
        instance(0.0, 0.6, score=0.2),
    ]
    outcome = look()
    assert outcome.status is Status.SUCCESS
    detection = outcome.outputs["detection"]
    assert (detection.index, detection.found, detection.score) == (1, 2, 0.8)
    assert np.array_equal(detection.T_base_camera, T_BASE_CAMERA)
    assert np.allclose(detection.T_camera_object[:3, 3], (-0.1, 0.0, 0.4))
    assert detection.keypoints.shape == (9, 2)
    assert detection.covariance.shape == (6, 6)
    assert detection.fruit.name == "apple"
    (topic, view), *_ = outcome.published
    assert topic == "detection"
    assert [line.style for line in view.lines] == ["muted", "found"]


def test_a_fruit_that_the_picture_s_edge_cuts_is_looked_at_from_elsewhere(
    scripted: list[Instance],
) -> None:
    scripted += [instance(0.25, 0.5)]
    skill = Detect()
    outcome = look(skill)
    assert outcome.reason is not None
    assert outcome.reason.code == "LOW_CONFIDENCE"
    lacking = next(value for topic, value in outcome.published if topic == "account")
    assert "edge cuts" in lacking.words  # type: ignore[attr-defined]
    scripted[:] = [instance(0.0, 0.5)]
    found = look(skill)
    withdrawn = next(value for topic, value in found.published if topic == "account")
    assert (found.status, withdrawn.words) == (Status.SUCCESS, "")  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("policy", "expected"),
    [("nearest", 1), ("largest", 2), ("most_visible", 0), ("surest", 0)],
)
def test_policies_choose(scripted: list[Instance], policy: str, expected: int) -> None:
    wide = instance(0.15, 0.55)
    wide = replace(wide, keypoints=(wide.keypoints - wide.keypoints[8]) * 2 + wide.keypoints[8])
    scripted += [
        instance(0.1, 0.6, 0.95, 1.0),
        instance(-0.1, 0.4, 0.9, 0.5),
        replace(wide, visibility=0.7),
    ]
    assert look(target=policy).outputs["detection"].index == expected


def test_fruit_chosen_before_comes_last(scripted: list[Instance]) -> None:
    scripted += [instance(0.1, 0.5), instance(-0.1, 0.6)]
    skill = Detect()
    chosen = [look(skill).outputs["detection"].index for _ in range(3)]
    assert chosen == [0, 1, 0]


def test_fruit_chosen_before_may_be_chosen_freely_or_never(scripted: list[Instance]) -> None:
    scripted += [instance(0.1, 0.5)]
    skill = Detect()
    assert look(skill).status is Status.SUCCESS
    assert look(skill, reselect="freely").status is Status.SUCCESS
    outcome = look(skill, reselect="never")
    assert outcome.reason is not None
    assert outcome.reason.code == "NOTHING_FOUND"


def test_a_doubtful_find_is_chosen_from_the_second_look_on_when_nothing_surer_is_left(
    scripted: list[Instance],
) -> None:
    scripted += [
        instance(0.1, 0.5, score=0.9),
        instance(-0.1, 0.6, score=0.45),
        instance(0.0, 0.7, score=0.2),
    ]
    skill = Detect()
    chosen = [look(skill, fallback_score=0.4).outputs["detection"].index for _ in range(3)]
    assert chosen == [0, 1, 0]
    assert look(skill, fallback_score=0.4, reselect="never").status is Status.FAILURE
    surest_first = [look(Detect()).outputs["detection"].index for _ in range(2)]
    assert surest_first == [0, 0]


def test_a_doubtful_find_is_not_chosen_at_the_first_look(scripted: list[Instance]) -> None:
    scripted += [instance(0.0, 0.5, score=0.45)]
    skill = Detect()
    first, second = look(skill, fallback_score=0.4), look(skill, fallback_score=0.4)
    assert first.reason is not None
    assert first.reason.code == "LOW_CONFIDENCE"
    assert second.status is Status.SUCCESS


def test_the_same_fruit_is_known_again_from_another_place(scripted: list[Instance]) -> None:
    skill = Detect()
    scripted[:] = [instance(0.0, 0.5), instance(0.15, 0.55)]
    assert look(skill).outputs["detection"].index == 0
    moved = replace(frame(), T_mount_camera=transform(T_BASE_CAMERA[:3, :3], (0.05, -0.4, 0.6)))
    scripted[:] = [instance(-0.05, 0.5), instance(0.10, 0.55)]
    assert look(skill, moved).outputs["detection"].index == 1


@pytest.mark.parametrize(("behind", "index"), [(0.08, 1), (0.02, None)])
def test_a_fruit_close_behind_one_that_was_chosen_is_another_fruit(
    scripted: list[Instance], behind: float, index: int | None
) -> None:
    def seen(shift: float, *depths: float) -> Frame:
        scripted[:] = [instance(shift * k, 0.5) for k in range(len(depths))]
        depth = np.full((480, 640), np.nan, np.float32)
        for each, d in zip(scripted, depths, strict=True):
            depth[:, round(each.keypoints[8, 0]) - 3 : round(each.keypoints[8, 0]) + 4] = d
        return replace(frame(), depth=depth)

    skill = Detect()
    assert look(skill, seen(0.03, 0.5), reselect="never").status is Status.SUCCESS
    outcome = look(skill, seen(0.03, 0.5, 0.5 + behind), reselect="never")
    assert (
        outcome.outputs["detection"].index if outcome.status is Status.SUCCESS else None
    ) == index


def test_progress_counts_the_fruit_of_this_look_and_those_that_are_gone(
    scripted: list[Instance],
) -> None:
    skill = Detect()
    scripted[:] = [instance(0.1, 0.5), instance(-0.1, 0.6), instance(0.0, 0.7)]
    told = [dict(look(skill).published)["progress"]]
    scripted[:] = scripted[1:]  # the first was put away
    told += [dict(look(skill).published)["progress"] for _ in range(3)]
    assert [(progress.number, progress.of) for progress in told] == [(1, 3), (2, 3), (3, 3), (2, 3)]


def test_failures_have_their_codes(scripted: list[Instance]) -> None:
    def code(outcome: SkillEnd) -> str:
        assert outcome.status is Status.FAILURE
        assert outcome.reason is not None
        return outcome.reason.code

    assert code(drive(Detect(), {"fruit": "apple"}, devices={Camera: OneFrame(None)})) == "NO_FRAME"
    assert (
        code(
            drive(
                Detect(),
                {"fruit": "apple"},
                devices={Camera: OneFrame(frame())},
                clock=ManualClock(2.0),
            )
        )
        == "STALE_FRAME"
    )
    assert code(look()) == "NOTHING_FOUND"
    scripted[:] = [instance(0.0, 0.5, score=0.3)]
    assert code(look()) == "LOW_CONFIDENCE"
    assert look(score=0.2).status is Status.SUCCESS
    scripted[:] = [instance(0.0, 0.5, posed=False)]
    assert code(look()) == "POSE_UNSOLVED"
    assert code(look(fruit="durian")) == "NO_WEIGHTS"


def test_a_frame_that_cannot_be_used_is_no_frame(
    monkeypatch: pytest.MonkeyPatch, scripted: list[Instance]
) -> None:
    def refuse(*_: object) -> list[Instance]:
        raise BadFrame("(h, w, 3) uint8 RGB", "(480, 640) float64")

    monkeypatch.setattr(looking, "find_in_frame", refuse)
    outcome = look()
    assert outcome.reason is not None
    assert outcome.reason.code == "NO_FRAME"
    assert "uint8 RGB" in outcome.reason.message


def test_ranking_is_total_for_equal_instances() -> None:
    same = [instance(0.0, 0.5), instance(0.0, 0.5)]
    for policy in ("nearest", "largest", "most_visible", "surest"):
        assert rank(same, policy) == [0, 1]


def test_a_fruit_is_chosen_so_many_times_and_the_others_first(scripted: list[Instance]) -> None:
    scripted += [instance(0.1, 0.5), instance(-0.1, 0.6)]
    skill = Detect()
    chosen = [
        look(skill, reselect="never", max_selections=2).outputs["detection"].index for _ in range(4)
    ]
    assert chosen == [0, 1, 0, 1]
    outcome = look(skill, reselect="never", max_selections=2)
    assert outcome.reason is not None
    assert outcome.reason.code == "NOTHING_FOUND"
    assert outcome.reason.message == "all 2 fruit in the frame were chosen 2 times"


def test_a_users_own_weights_and_config_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[object, object]] = []

    def finds(_frame: Frame, fruit: FruitModel, options: object) -> list[Instance]:
        asked.append((fruit.weights, options))
        return [instance(0.0, 0.5)]

    monkeypatch.setattr(looking, "find_in_frame", finds)
    assert look(weights="pears/own.weights").status is Status.SUCCESS
    assert asked.pop() == (Path("pears/own.weights"), DetectorOptions())
    assert look(weights="apple_photographs.weights").status is Status.SUCCESS
    assert asked.pop()[0] == catalogue.SHIPPED_WEIGHTS / "apple_photographs.weights"
    assert look(weights="epoch_60.pth", config="config_pose.yaml").status is Status.SUCCESS
    assert asked.pop()[1] == DopeFiles(Path("epoch_60.pth"), Path("config_pose.yaml"))
    outcome = look(config="config_pose.yaml")
    assert outcome.reason is not None
    assert outcome.reason.code == "NO_WEIGHTS"


@pytest.mark.parametrize(
    ("inputs", "width"),
    [
        ({}, 320),
        ({"working_width": 448}, 448),
        ({"working_width": "448"}, 448),  # of a text parameter
        ({"working_width": "all"}, None),
        ({"working_width": "auto"}, None),  # no distance is known
    ],
)
def test_the_working_width_is_a_number_or_follows_from_the_distance(
    monkeypatch: pytest.MonkeyPatch, inputs: dict[str, Any], width: int | None
) -> None:
    asked: list[DetectorOptions] = []

    def finds(_frame: Frame, _fruit: FruitModel, options: DetectorOptions) -> list[Instance]:
        asked.append(options)
        return [instance(0.0, 0.8)]

    monkeypatch.setattr(looking, "find_in_frame", finds)
    skill = Detect()
    assert look(skill, **inputs).status is Status.SUCCESS
    assert asked.pop().working_width == width
    assert look(skill, **inputs).status is Status.SUCCESS
    # 46 px × 640 × 0.8 m / (610.6 px × 97.6 mm)
    from_last_look = 395 if inputs == {"working_width": "auto"} else width
    assert asked.pop().working_width == from_last_look


@pytest.mark.parametrize("width", [20, 5000, "wide", 320.5, True, "²"])
def test_another_working_width_is_refused_before_a_run_and_in_it(
    scripted: list[Instance], width: object
) -> None:
    scripted.append(instance(0.0, 0.5))
    (problem,) = Detect.judge({"working_width": width}, None)
    assert (problem.key, str(width) in problem.message) == ("working_width", True)
    outcome = look(working_width=width)
    assert outcome.reason is not None
    assert outcome.reason.code == "BAD_VALUE"


@pytest.mark.parametrize(
    "inputs", [{"weights": "none.pt"}, {"weights": "none.pth", "config": "none.yaml"}]
)
def test_files_of_a_user_that_are_not_there_are_a_failure_in_words(inputs: dict[str, str]) -> None:
    outcome = look(**inputs)
    assert outcome.status is Status.FAILURE
    assert outcome.reason is not None
    assert outcome.reason.code == "NO_WEIGHTS"
    assert "none." in outcome.reason.message


def test_nothing_of_the_apple_is_loaded_when_a_lemon_is_looked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loaded: list[str] = []

    def load(name: str) -> FruitModel:
        loaded.append(name)
        return load_fruit(name)

    monkeypatch.setattr(looking, "load_fruit", load)
    monkeypatch.setattr(looking, "_detector", lambda weights: loaded.append(weights.name))
    skill = Detect()
    monkeypatch.setattr(skill, "known", {"fruit": "lemon", "weights": ""}.get)
    skill.prepare()
    assert loaded == ["lemon", "lemon.weights"]


def test_refine_is_prepared_without_any_fruit_of_the_catalogue(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> FruitModel:
        raise AssertionError("a fruit was loaded")

    monkeypatch.setattr(catalogue, "load_fruit", refuse)
    monkeypatch.setattr(catalogue, "_read_mesh", refuse)
    Refine().prepare()
