"""The README of the drivers follows one frame: it has the fields that are listed, and the named places exist."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from pomona import drivers
from pomona.drivers.interfaces import Camera
from pomona.drivers.services import RobotServices
from pomona.drivers.streams import FrameGuard, WrenchStream
from pomona.executive.cell.cell import Cell
from pomona.tools.simulation.camera import Delivery, SimCamera

FOLDER = Path(drivers.__file__).parent
PAGE = (FOLDER / "README.md").read_text("utf-8")
PLACES = (FOLDER, FOLDER.parent / "tools")


def test_a_frame_has_the_fields_and_shapes_that_are_listed(open_cell: Callable[..., Cell]) -> None:
    camera = open_cell(seed=3).device(Camera)
    frame = camera.latest()
    assert frame is not None
    assert camera.latest() is frame
    rows = dict(re.findall(r"^\| `(\w+)` \| (\([^)]*\)|[^|]*) \|$", PAGE, re.MULTILINE))
    assert all(getattr(frame, name) is not None for name in rows)
    h, w = frame.depth.shape
    shapes = {"(h, w, 3)": (h, w, 3), "(h, w)": (h, w), "(4, 4)": (4, 4)}
    listed = {name: shapes[value] for name, value in rows.items() if value in shapes}
    assert len(listed) == 3
    assert {name: getattr(frame, name).shape for name in listed} == listed


def test_every_file_and_class_that_is_named_exists() -> None:
    files = set(re.findall(r"(?<![\w`.])((?:\w+/)?\w+\.py)", PAGE))
    assert len(files) > 15
    assert [
        name for name in sorted(files) if not any((place / name).is_file() for place in PLACES)
    ] == []
    for found in (RobotServices, SimCamera.latest, Delivery, FrameGuard.judge, WrenchStream):
        assert f"`{found.__qualname__}`" in PAGE


def test_the_page_is_short() -> None:
    assert len(re.findall(r"\S*[a-zA-Z]\S*", PAGE)) <= 400
