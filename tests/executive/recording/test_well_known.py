"""A record for other tools: every message obeys its schema, frames are connected, poses are right."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from mcap.reader import make_reader
from recorded_events import contents, everything, pose, record

from pomona.executive.recording.read import read_events
from pomona.executive.recording.well_known import Images, plain_name
from pomona.executive.running.events import Published
from pomona.executive.views import ImageView


def strict(schema: Any) -> Any:
    """Return the schema without additional properties, so that a misspelt field is found."""
    if isinstance(schema, dict):
        closed = {key: strict(value) for key, value in schema.items()}
        if schema.get("type") == "object" and schema.get("properties"):
            closed = {
                "additionalProperties": False,
                "required": list(schema["properties"]),
                **closed,
            }
        return closed
    return [strict(item) for item in schema] if isinstance(schema, list) else schema


def test_every_message_obeys_its_schema_to_the_letter(tmp_path: Path) -> None:
    seen = set()
    for topic, name, schema, content in contents(record(tmp_path, everything())):
        jsonschema.validate(content, schema if name == "pomona.Event" else strict(schema))
        seen.add(name)
        assert topic.startswith("/")
    assert seen == {
        "pomona.Event", "pomona.Sample", "pomona.Reading", "foxglove.CompressedImage", "foxglove.CameraCalibration",
        "foxglove.PoseInFrame", "foxglove.PosesInFrame", "foxglove.FrameTransforms", "foxglove.PointCloud",
        "foxglove.SceneUpdate", "foxglove.Log", "pomona.Intervention",
    }  # fmt: skip


def test_every_frame_hangs_on_the_base(tmp_path: Path) -> None:
    parents, used = {}, set()
    for _topic, name, _schema, content in contents(record(tmp_path, everything())):
        if name == "foxglove.FrameTransforms":
            parents |= {t["child_frame_id"]: t["parent_frame_id"] for t in content["transforms"]}
        used |= {content[key] for key in ("frame_id",) if key in content}
        used |= {entity["frame_id"] for entity in content.get("entities", ())}
    assert parents == {
        "robot/0": "base", "camera/detection": "base", "detection/camera": "base", "truth/fruit": "base",
        "detection/object": "detection/camera",
    }  # fmt: skip
    assert used <= {"base", *parents}


def test_poses_are_those_of_the_values(tmp_path: Path) -> None:
    found = {
        topic: content
        for topic, _name, _schema, content in contents(record(tmp_path, everything()))
    }
    camera = found["/poses/detection/camera"]["pose"]
    assert camera["position"]["x"] == pytest.approx(0.5)
    assert camera["orientation"]["z"] == pytest.approx(np.sin(0.1))
    assert [
        p["position"]["x"] for p in found["/poses/detection/candidates"]["poses"]
    ] == pytest.approx([0.1, 0.2])


def test_tree_cell_parameters_seed_versions_and_commit_are_inside(tmp_path: Path) -> None:
    with record(tmp_path, everything()).open("rb") as stream:
        reader = make_reader(stream)
        attachments = {
            attachment.name: attachment.data.decode() for attachment in reader.iter_attachments()
        }
        (about,) = [
            metadata.metadata
            for metadata in reader.iter_metadata()
            if metadata.name == "pomona.run"
        ]
    assert attachments["tree.yaml"] == "pomona: 1\n"
    assert attachments["cell.yaml"] == "name: sim\n"
    assert attachments["look.yaml"] == "pomona: 1\ntree: look\n"
    assert about["seed"] == "3"
    assert about["version.git"] == "0123abc"
    assert json.loads(about["parameters"]) == {"height": 0.15}
    assert json.loads(about["settings"]) == {"fruit": "apple_5"}


def test_depth_comes_back_to_the_millimetre(tmp_path: Path) -> None:
    record(tmp_path, everything())
    (view,) = [
        e.value
        for e in read_events(tmp_path)
        if isinstance(e, Published) and e.topic == "detection"
    ]
    assert view.depth[0, 0] == 0.0
    np.testing.assert_allclose(view.depth[1:], 0.750, atol=1e-6)
    assert view.pinhole.fx == 60.0
    np.testing.assert_allclose(view.pinhole.T_base_camera, pose(0.3))


def test_an_image_that_two_skills_draw_on_is_coded_once_and_shown_twice() -> None:
    coder, view = Images(), ImageView(image=np.full((8, 8, 3), 90, np.uint8))
    other = ImageView(image=np.full((8, 8, 3), 200, np.uint8))
    shown = [
        next(coder.messages(topic, v, 0))
        for topic, v in (("detect", view), ("refine", view), ("next", other))
    ]
    assert [topic for topic, _, _ in shown] == ["/images/detect", "/images/refine", "/images/next"]
    assert shown[0][2]["data"] is shown[1][2]["data"]
    assert shown[2][2]["data"] != shown[0][2]["data"]


def test_the_log_has_the_messages_for_the_operator(tmp_path: Path) -> None:
    found = contents(record(tmp_path, everything()))
    log = [
        (content["level"], content["message"])
        for topic, _n, _s, content in found
        if topic == "/log"
    ]
    assert (3, "NO_PATH: there is no path") in log
    assert (2, "detection: an apple") in log
    assert log[-1] == (4, "failure: NO_PATH: there is no path")


def test_a_samples_gap_is_left_out(tmp_path: Path) -> None:
    found = [
        content
        for topic, _n, _s, content in contents(record(tmp_path, everything()))
        if topic == "/series/grip"
    ]
    assert found == [{"t": 0.5, "slip_speed_m_per_s": 0.1}, {"t": 0.6}]


def test_names_fit_into_a_plots_path() -> None:
    assert plain_name("grasp force [N]") == "grasp_force_N"
    assert plain_name("slip speed [m/s]") == "slip_speed_m_per_s"
