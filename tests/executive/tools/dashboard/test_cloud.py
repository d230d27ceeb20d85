"""The depth of a look in space: the same points live and from a record, where the pinhole camera puts them."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_events import foreign

from pomona.executive.encode import encoded
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import Published, RunEnded
from pomona.executive.views import ImageView, Pinhole
from pomona.tools.dashboard import cloud as module
from pomona.tools.dashboard.cloud import cloud_of
from pomona.tools.dashboard.messages import encode
from pomona.tools.dashboard.record_messages import cloud, overview

T = np.array(
    [[1.0, 0.0, 0.0, 0.1], [0.0, -1.0, 0.0, 0.2], [0.0, 0.0, -1.0, 0.9], [0.0, 0.0, 0.0, 1.0]]
)
LENS = Pinhole(40.0, 40.0, 15.5, 11.5, T)


def look() -> ImageView:
    image = np.zeros((24, 32, 3), np.uint8)
    image[..., 0] = 200
    depth = np.full((24, 32), 0.5, np.float32)
    depth[:4] = 0.0  # nothing was seen there
    depth[4] = 9.0  # too far away to be of use
    return ImageView(image, depth=depth, pinhole=LENS)


def points(packed: dict[str, str]) -> np.ndarray[Any, Any]:
    return np.frombuffer(base64.b64decode(packed["mm"]), "<i2").reshape(-1, 3) * 1e-3


def test_depth_becomes_points_where_the_camera_saw_them() -> None:
    packed = cloud_of(look())
    assert packed is not None
    p_base = points(packed)
    assert len(p_base) == 19 * 32
    assert p_base[:, 2] == pytest.approx(
        0.4
    )  # half a metre below a camera at 0.9 m that looks down
    assert p_base[0] == pytest.approx(
        [0.1 - 15.5 * 0.5 / 40.0, 0.2 + 6.5 * 0.5 / 40.0, 0.4], abs=1e-3
    )
    assert len(base64.b64decode(packed["rgb"])) == p_base.size


@pytest.mark.parametrize("lacks", ["depth", "pinhole", "image", "pose"])
def test_a_look_without_depth_or_pose_has_no_points(lacks: str) -> None:
    values: dict[str, Any] = {"image": look().image, "depth": look().depth, "pinhole": LENS}
    values |= {"pinhole": Pinhole(40.0, 40.0, 15.5, 11.5)} if lacks == "pose" else {lacks: None}
    assert cloud_of(ImageView(**values)) is None


def test_a_record_gives_the_points_that_were_shown_live(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    for tick in range(3):
        recorder.on_event(Published(tick * 1.0, tick, "n", "camera", look()))
    recorder.on_event(RunEnded(3.0, 3, "success", None, 3, 3.0, 3.0, None))
    recorder.close()
    live = json.loads(encode(Published(0.0, 0, "n", "camera", look()), 1))["value"]["cloud"]
    lines = [json.loads(line) for line in b"".join(overview(tmp_path, "/images/")).splitlines()]
    for line in lines[:3]:
        at, _, word = line["value"]["cloud"].removeprefix("/images/").partition("/")
        assert word == "cloud"
        packed = cloud(tmp_path, at)
        assert points(packed) == pytest.approx(points(live), abs=1e-3)
    assert cloud(tmp_path, "0-7") == {}
    assert cloud(tmp_path, f"{10**30}-0") == {}


def test_a_picture_that_claims_to_be_huge_is_not_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path)
    recorder.on_event(Published(0.0, 0, "n", "camera", look()))
    recorder.close()
    (line,) = (json.loads(line) for line in b"".join(overview(tmp_path, "/images/")).splitlines())
    at = line["value"]["cloud"].split("/")[2]
    assert cloud(tmp_path, at)
    monkeypatch.setattr(module, "MOST_PIXELS", 24 * 32 - 1)
    assert cloud(tmp_path, at) == {}


@pytest.mark.parametrize("kind", ["ImageView", "SceneView"])
def test_a_record_names_no_address_that_a_page_opens_with_its_token(
    tmp_path: Path, kind: str
) -> None:
    value = {
        "type": kind,
        "cloud": "https://evil.example/",
        "image": "https://evil.example/",
        "size": 7,
        "caption": "x",
    }
    event = {
        "event": "Published",
        "t": 0.0,
        "tick": 0,
        "node": "n",
        "topic": "camera",
        "value": value,
    }
    folder = foreign(tmp_path / "r", encoded(event), encoded(event | {"value": {"size": 7}}))
    view, other = (
        json.loads(line)["value"] for line in b"".join(overview(folder, "/images/")).splitlines()
    )
    assert view == {"type": kind, "caption": "x"}
    assert other == {"size": 7}  # a value of another kind is shown as it is
