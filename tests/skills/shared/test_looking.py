"""Which detector looks, at which width, in which frame, and what is drawn of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pomona.drivers.errors import FrameUnreadable
from pomona.drivers.interfaces import Arm, Camera, FruitKinds
from pomona.executive.skill import SkillFailure
from pomona.skills.perception.detection.detection import (
    WORKING_WIDTH,
    BoxModelFile,
    DetectorOptions,
    DopeFiles,
)
from pomona.skills.perception.detection.errors import BadFrame, BadWeights
from pomona.skills.perception.detection.instances import Instance
from pomona.skills.perception.detection.places import width_for
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.shared import looking
from pomona.skills.shared.looking import LookingSkill, boxes_width, find_in_frame, picture
from tests.skills.overhead import LENS, T_BASE_CAMERA
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL, PickingScene

APPLE = load_fruit("apple")


class Told(Exception):
    """Stands for a skill's failure."""


def skill_with(**changed: Any) -> Any:
    """A skill that looks, with these devices or values in the place of its own."""
    skill = LookingSkill.__new__(LookingSkill)
    given = {
        "failure": lambda code, message, **data: Told(code, message, data),
        "_known": {}, "_devices": {},
    } | changed  # fmt: skip
    stand_in: Any = SimpleNamespace(
        **{name: getattr(LookingSkill, name).__get__(skill) for name in ("judge", "offers")}
    )
    for name, value in given.items():
        setattr(stand_in, name, value)
    for name in ("fruit_model", "newest_frame", "search_width", "camera_pose", "find", "prepare"):
        setattr(stand_in, name, getattr(LookingSkill, name).__get__(stand_in))
    return stand_in


@pytest.mark.parametrize(
    ("given", "width"),
    [
        (64, 64), ("64", 64), (4096, 4096), ("all", "all"), ("auto", "auto"), (63, None), (4097, None),
        ("65536", None), ("640 px", None), ("", None), (-100, None), ("٦٤٠", None), (640.0, None),
    ],
)  # fmt: skip
def test_a_width_is_a_number_of_pixels_or_a_word(given: object, width: int | str | None) -> None:
    assert looking._width(given) == width
    assert boxes_width(given) == (width if isinstance(width, int) else WORKING_WIDTH)


def test_a_picture_is_searched_at_the_width_that_is_given_or_follows_from_the_distance() -> None:
    frame: Any = SimpleNamespace(intrinsics=LENS, colour=np.zeros((480, 640, 3), np.uint8))
    find = skill_with().search_width
    assert find(320, APPLE, frame, 0.5) == 320
    assert find("all", APPLE, frame, 0.5) is None
    assert find("auto", APPLE, frame, None) is None
    size = float(APPLE.dimensions.max())
    assert find("auto", APPLE, frame, 0.5) == width_for(0.5, size, LENS.fx, 640)
    assert find("auto", APPLE, frame, 0.5) != width_for(1.5, size, LENS.fx, 640)
    with pytest.raises(SkillFailure) as failed:
        find("wide", APPLE, frame, 0.5)
    assert failed.value.failure.code == "BAD_VALUE"
    assert failed.value.failure.message.startswith(
        "input working_width: wide is not a width from 64"
    )


@pytest.mark.parametrize(("age", "code"), [(0.499, ""), (0.5, ""), (0.51, "STALE_FRAME")])
def test_the_newest_frame_is_taken_until_it_is_too_old(age: float, code: str) -> None:
    frame = SimpleNamespace(stamp=10.0 - age)
    camera = SimpleNamespace(latest=lambda: frame)
    skill = skill_with(device={Camera: camera}.__getitem__, clock=SimpleNamespace(now=lambda: 10.0))
    if not code:
        assert skill.newest_frame() is frame
        return
    with pytest.raises(Told) as told:
        skill.newest_frame()
    assert told.value.args[0] == code
    assert told.value.args[1] == "the newest frame is 0.51 s old, 0.5 s are allowed"
    assert told.value.args[2]["age_s"] == pytest.approx(age)


def test_no_frame_and_an_unreadable_one_are_named() -> None:
    def unreadable() -> None:
        raise FrameUnreadable("camera", "the file is damaged")

    for latest, words in (
        (lambda: None, "the camera has not delivered a frame yet"),
        (unreadable, "the file is damaged"),
    ):
        skill = skill_with(device=lambda _kind, latest=latest: SimpleNamespace(latest=latest))
        with pytest.raises(Told) as told:
            skill.newest_frame()
        assert told.value.args[:2] == ("NO_FRAME", words)


def test_a_frame_has_the_pose_of_its_mount_on_the_arm_or_in_the_cell() -> None:
    T_mount_camera = T_BASE_CAMERA.copy()
    arm = PickingScene().arm
    skill = skill_with(optional_device={Arm: arm}.get)
    fixed: Any = SimpleNamespace(q=None, T_mount_camera=T_mount_camera)
    riding: Any = SimpleNamespace(q=OBSERVE, T_mount_camera=T_mount_camera)
    assert skill.camera_pose(fixed) is T_mount_camera
    np.testing.assert_allclose(skill.camera_pose(riding), ROBOT_MODEL.fk(OBSERVE) @ T_mount_camera)
    with pytest.raises(Told, match="the cell has no arm"):
        skill_with(optional_device={}.get).camera_pose(riding)


def test_a_fruit_is_found_by_its_own_weights_or_those_that_are_named(tmp_path: Path) -> None:
    skill = skill_with()
    assert skill.fruit_model("apple").weights == APPLE.weights
    assert skill.fruit_model("apple", "lemon.weights").weights == load_fruit("lemon").weights
    assert skill.fruit_model("apple", str(tmp_path / "own")).weights == tmp_path / "own"
    with pytest.raises(Told) as told:
        skill.fruit_model("moon")
    assert told.value.args[0] == "NO_WEIGHTS"
    assert told.value.args[2] == {"fruit": "moon"}


def test_a_fruit_without_weights_is_refused_where_these_are_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bare = replace(APPLE, weights=None)
    monkeypatch.setattr(looking, "load_fruit", lambda _name: bare)
    skill = skill_with()
    assert skill.fruit_model("apple", needs_weights=False) is bare
    with pytest.raises(Told) as told:
        skill.fruit_model("my/apple")
    code, words, _data = told.value.args
    assert code == "NO_WEIGHTS"
    assert words.endswith(
        "pomona train detect --fruit my/apple --out apple.weights, then wire 'weights: apple.weights' beside 'fruit'"
    )
    (problem,) = LookingSkill.judge({"fruit": "apple"}, None)
    assert (problem.key, problem.message) == ("fruit", "there are no weights to find apple by")


def problems(cell: Any = None, **known: Any) -> list[tuple[str, str]]:
    return [
        (problem.key + " warning" * problem.warning, problem.message)
        for problem in LookingSkill.judge(known, cell)
    ]


def test_files_that_are_not_there_are_found_before_the_run(tmp_path: Path) -> None:
    model = tmp_path / "boxes.onnx"
    model.touch()
    assert problems(fruit="apple") == problems() == problems(fruit="apple", boxes=str(model)) == []
    gone = str(tmp_path / "gone")
    assert problems(fruit="apple", weights=gone) == [("weights", f"there is no file {gone}")]
    assert problems(fruit="apple", boxes=gone) == [("boxes", f"there is no file {gone}")]
    assert problems(fruit="apple", boxes=str(model), weights=gone, pose_from="depth") == []
    assert problems(fruit="apple", boxes=str(model), weights=gone, pose_from="look") == [
        ("weights", f"there is no file {gone}")
    ]
    ((key, words),) = problems(working_width="wide")
    assert key == "working_width"
    assert words.startswith("wide is not a width")
    assert problems(working_width="all") == []
    ((key, _words),) = problems(fruit="moon")
    assert key == "fruit"


def test_a_fruit_that_is_not_on_the_cells_table_is_warned_of() -> None:
    kinds = SimpleNamespace(names=("pear", "lemon"))
    cell = SimpleNamespace(name="bench", known=lambda kind: kinds if kind is FruitKinds else None)
    words = "there is no apple on the table of the cell 'bench', which holds pear, lemon"
    assert problems(cell, fruit="apple") == [("fruit warning", words)]
    assert problems(cell, fruit="lemon") == []
    kinds.names = ("apple",)
    assert problems(cell, fruit="apple") == []
    assert LookingSkill.offers("fruit", cell) == ("apple",)  # type: ignore[arg-type]
    assert LookingSkill.offers("score", cell) == ()  # type: ignore[arg-type]
    assert "apple" in LookingSkill.offers("fruit", None)


def test_the_detector_of_the_values_that_are_known_is_loaded_before_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    loaded: list[Any] = []
    monkeypatch.setattr(looking, "_detector", lambda weights: loaded.append(weights))
    monkeypatch.setattr(looking, "_own_detector", lambda *given: loaded.append(given))
    sides = tuple(APPLE.dimensions.tolist())

    def prepared(**known: Any) -> Any:
        loaded.clear()
        skill_with(known=known.get).prepare()
        return loaded[0] if loaded else None

    assert prepared() is None
    assert prepared(fruit="apple") == APPLE.weights
    lemon = load_fruit("lemon").weights
    assert prepared(fruit="apple", weights="lemon.weights") == lemon
    assert prepared(fruit="apple", weights="a.pth", config="a.yaml") == (
        DopeFiles(Path("a.pth"), Path("a.yaml")), "apple", None, sides,
    )  # fmt: skip
    assert prepared(fruit="apple", boxes="b.onnx", working_width=320, pose_from="depth") == (
        BoxModelFile(Path("b.onnx"), "depth", 320), "apple", APPLE.weights, sides,
    )  # fmt: skip
    plain = BoxModelFile(Path("b.onnx"))
    assert prepared(fruit="apple", boxes="b.onnx", weights="lemon.weights") == (
        BoxModelFile(plain.model, plain.pose, WORKING_WIDTH), "apple", lemon, sides,
    )  # fmt: skip
    bare = replace(APPLE, weights=None)
    monkeypatch.setattr(looking, "load_fruit", lambda _name: bare)
    with pytest.raises(BadWeights, match="is missing: restore it, or train the detector"):
        prepared(fruit="apple")


def test_a_frame_is_given_to_the_detector_of_the_fruit_or_to_the_users_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frame: Any = SimpleNamespace(colour="colour", depth="depth", intrinsics=SimpleNamespace(K="K"))
    own = SimpleNamespace(find_instances=lambda *given: given)
    monkeypatch.setattr(looking, "_own_detector", lambda *given: own)
    assert find_in_frame(frame, APPLE, BoxModelFile(Path("b"))) == ("colour", "K", "depth")
    looks: list[Any] = []

    def looking_at(options: Any) -> str:
        looks.append(options)
        return "detector"

    monkeypatch.setattr(looking, "_detector", lambda _w: SimpleNamespace(looking=looking_at))
    monkeypatch.setattr(looking, "find_instances", lambda *given: given)
    options = DetectorOptions()
    assert find_in_frame(frame, APPLE, options) == ("detector", "colour", "K", APPLE)
    assert looks == [replace(options, kind="apple")]


@pytest.mark.parametrize(
    ("error", "code"),
    [(BadFrame("RGB", "grey"), "NO_FRAME"), (BadWeights("a", "is cut"), "NO_WEIGHTS")],
)
def test_what_is_wrong_while_it_looks_is_the_skills_failure(error: Exception, code: str) -> None:
    def compute(*_given: Any) -> Any:
        yield None
        raise error

    work = skill_with(compute=compute).find(None, APPLE, None)
    next(work)
    with pytest.raises(Told) as told:
        next(work)
    assert told.value.args[0] == code
    assert str(error) in told.value.args[1]


def one(score: float, at: float) -> Instance:
    return Instance(np.full((9, 2), at), score, 1.0, None, None)


@pytest.mark.parametrize(
    ("chosen", "caption"),
    [(2, "2 found, target 2"), ("too far", "2 found, too far"), ("", "2 found")],
)
def test_the_view_has_all_instances_of_the_score_and_marks_the_target(
    chosen: int | str, caption: str
) -> None:
    frame: Any = SimpleNamespace(colour=np.zeros((4, 4, 3), np.uint8), depth=None, intrinsics=LENS)
    view = picture(
        frame, T_BASE_CAMERA, [one(0.5, 1.0), one(0.49, 2.0), one(0.9, 3.0)], chosen, 0.5
    )
    assert view.caption == caption
    np.testing.assert_array_equal(view.points, [[1.0, 1.0], [3.0, 3.0]])
    assert [line.label for line in view.lines] == ["fruit 0, score 0.50", "fruit 2, score 0.90"]
    assert [line.style for line in view.lines] == ["muted", "found" if chosen == 2 else "muted"]
    assert all(line.points.shape == (16, 2) for line in view.lines)
    assert (view.pinhole.fx, view.pinhole.fy) == (LENS.fx, LENS.fy)
    assert (view.pinhole.cx, view.pinhole.cy) == (LENS.cx, LENS.cy)
