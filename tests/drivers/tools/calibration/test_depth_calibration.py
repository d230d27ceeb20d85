"""A depth model from balls and walls: against sensors of known errors, and insufficient data."""

import argparse
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pomona.devices.frames.folder import read_depth_model
from pomona.drivers.depth_model import SENSORS
from pomona.drivers.interfaces import Frame, Intrinsics
from pomona.executive.cell.cell import Cell
from pomona.tools.calibration import command_calibrate as calibrate
from pomona.tools.calibration.depth_calibration import (
    Ball,
    UnusableDepth,
    calibrate_balls,
    calibrate_wall,
    look_at_ball,
    read_balls,
)
from pomona.tools.mock.hand import MockCamera, MockClock

CAMERA = Intrinsics(600.0, 600.0, 320.0, 240.0, 640, 480)
V, U = np.indices((480, 640))
RAYS = np.stack([(U - 320.0) / 600.0, (V - 240.0) / 600.0, np.ones((480, 640))], axis=-1)

Place = tuple[float, float, float, float]
"""Diameter and place x, y, z of a ball [m]."""

BALLS: dict[str, Place] = {
    "a": (0.12, -0.25, -0.15, 0.7),
    "b": (0.08, 0.2, -0.15, 0.6),
    "c": (0.15, -0.35, 0.25, 1.1),
    "d": (0.20, 0.4, 0.2, 1.5),
}


def seen(
    places: dict[str, Place],
    offset: float,
    scale: float,
    growth: float,
    wide: float = 0.0,
    seed: int = 0,
) -> tuple[list[Ball], NDArray[np.float32]]:
    """Balls with boxes `wide` pixels too wide, and their depth by a sensor with these errors; nothing behind them."""
    rng = np.random.default_rng(seed)
    depth, balls = np.zeros((480, 640)), []
    square = np.sum(RAYS**2, axis=-1)
    for name, (diameter, *centre) in places.items():
        along = RAYS @ np.array(centre)
        root = along**2 - square * (np.dot(centre, centre) - diameter**2 / 4.0)
        hit = root > 0.0
        depth[hit] = ((along - np.sqrt(np.maximum(root, 0.0))) / square)[hit]
        rows, columns = np.nonzero(hit)
        # Where a box of real size ends between two pixels: half of one on either side.
        size = np.array([np.ptp(columns) + 1.0, np.ptp(rows) + 1.0])
        balls.append(
            Ball(
                "f",
                name,
                (columns.min() - wide / 2, rows.min() - wide / 2, *(size + wide)),
                diameter,
            )
        )
    noisy = offset + (1.0 + scale) * depth + growth * depth**2 * rng.normal(size=depth.shape)
    return balls, np.where(depth > 0.0, noisy, 0.0).astype(np.float32)


def test_a_ball_has_the_same_distance_by_outline_and_by_depth_anywhere_in_the_picture() -> None:
    balls, depth = seen(BALLS, 0.0, 0.0, 5e-4)
    for ball in balls:
        true = BALLS[ball.name][3]
        told = look_at_ball(ball, depth, CAMERA)
        assert told.measured == pytest.approx(true, abs=2e-3)
        assert abs(told.true - true) < 2.0 * told.deviation
        assert told.scatter == pytest.approx(5e-4 * true**2, rel=0.4)


@pytest.mark.parametrize(("offset", "scale"), [(0.03, 0.0), (0.0, 0.04), (-0.02, -0.02)])
def test_bias_and_noise_are_found_within_their_stated_errors(offset: float, scale: float) -> None:
    balls, depth = seen(BALLS, offset, scale, 1e-3)
    found = calibrate_balls(balls, {"f": depth}, CAMERA, "d4xx")
    # The outlines of these balls leave offset and scale open against each other; what counts is the depth corrected.
    for place in BALLS.values():
        true = place[3]
        left = (
            found.model.corrected(np.array([offset + (1.0 + scale) * true], np.float32))[0] - true
        )
        assert abs(left) < 0.35 * abs(offset + scale * true)
        assert abs(left) < 2.0 * found.model.of_the_whole(true) * true
    assert found.model.growth == pytest.approx(1e-3, rel=0.3)
    assert found.after < 0.6 * found.before


def test_outlines_that_are_drawn_too_wide_are_not_taken_for_a_bias() -> None:
    balls, depth = seen(BALLS, 0.0, 0.0, 1e-3, wide=2.0)
    found = calibrate_balls(balls, {"f": depth}, CAMERA, "d4xx")
    assert found.outline_growth > 0.3
    for _, _, _, true in BALLS.values():
        wrong = abs(found.model.offset + true * found.model.scale)
        assert wrong < 2.0 * found.model.of_the_whole(true) * true


def test_insufficient_depth_is_refused() -> None:
    balls, depth = seen(BALLS, 0.02, 0.0, 1e-3)
    with pytest.raises(UnusableDepth, match="cannot separate bias from chance"):
        calibrate_balls(balls[:1] * 3, {"f": depth}, CAMERA, "d4xx")
    with pytest.raises(UnusableDepth, match="no frame 'f'"):
        calibrate_balls(balls, {"g": depth}, CAMERA, "d4xx")
    with pytest.raises(UnusableDepth, match="too little depth"):
        calibrate_balls(balls, {"f": np.zeros_like(depth)}, CAMERA, "d4xx")
    small = {name: (0.05, x, y, z) for name, (_, x, y, z) in BALLS.items()}
    little, depth = seen(small, 0.02, 0.0, 1e-4)
    with pytest.raises(UnusableDepth, match="was known before"):
        calibrate_balls(little, {"f": depth}, CAMERA, "azure_kinect")


def test_balls_that_contradict_each_other_are_refused() -> None:
    balls, depth = seen(BALLS, 0.0, 0.0, 1e-3)
    wrong = [
        Ball(b.frame, b.name, b.box, b.diameter * (1.08 if b.name in "ac" else 0.93)) for b in balls
    ]
    with pytest.raises(UnusableDepth, match=r"contradict|was known before"):
        calibrate_balls(wrong, {"f": depth}, CAMERA, "d4xx")


def test_a_wall_gives_the_noise_at_any_slant_and_an_uneven_one_is_refused() -> None:
    rng = np.random.default_rng(0)
    wall = 1.0 / (0.8 + 0.3 * RAYS[..., 0] - 0.2 * RAYS[..., 1])
    noisy = wall + 7e-4 * wall**2 * rng.normal(size=wall.shape)
    found = calibrate_wall([noisy.astype(np.float32)], "azure_kinect")
    assert found.model.growth == pytest.approx(7e-4, rel=0.05)
    assert found.model.scale_deviation == SENSORS["azure_kinect"].scale_deviation
    rough = noisy + 0.02 * (rng.random(wall.shape) > 0.5) * (U > 370)
    with pytest.raises(UnusableDepth, match="is flat"):
        calibrate_wall([rough.astype(np.float32)], "azure_kinect")
    with pytest.raises(UnusableDepth, match="wholly measured"):
        calibrate_wall([np.zeros_like(wall, dtype=np.float32)], "azure_kinect")
    with pytest.raises(
        UnusableDepth, match="has no noise"
    ):  # no depth model without noise can be read
        calibrate_wall([np.full_like(wall, 1.5, dtype=np.float32)], "azure_kinect")


def walls(*parts: tuple[int, float, float]) -> NDArray[np.float32]:
    """Flat pieces beside each other: each up to a column, with its inverse distance and slant, and noise."""
    depth, left = np.zeros((480, 640)), 0
    for right, near, slant in parts:
        depth[:, left:right] = 1.0 / (near + slant * RAYS[:, left:right, 0])
        left = right
    return (depth + 7e-4 * depth**2 * np.random.default_rng(3).normal(size=depth.shape)).astype(
        np.float32
    )


@pytest.mark.parametrize(
    "view",
    [
        pytest.param(walls((300, 0.8, 0.3), (640, 0.8, -0.9)), id="a corner"),
        pytest.param(walls((400, 1.2, 0.1), (640, 0.4, 0.0)), id="a small board"),
        pytest.param(
            walls(*((80 * k, 0.5 + 0.1 * (3 * k % 8), 0.0) for k in range(1, 9))), id="boxes"
        ),
    ],
)
def test_a_view_that_is_not_one_wall_gives_no_noise(view: NDArray[np.float32]) -> None:
    wall = walls((640, 0.8, 0.3))
    assert calibrate_wall([wall], "d4xx").model.growth == pytest.approx(7e-4, rel=0.05)
    with pytest.raises(UnusableDepth, match="lie on one plane: this is no wall"):
        calibrate_wall([wall, view], "d4xx")


def test_a_sensor_that_bends_a_wall_and_a_board_that_nearly_fills_the_frame_are_believed() -> None:
    bent = walls((640, 0.8, 0.3)) * (1.0 + 0.02 * RAYS[..., 0] ** 2 / RAYS[..., 0].max() ** 2)
    for view in (bent.astype(np.float32), walls((520, 1.0, 0.1), (640, 0.4, 0.0))):
        assert calibrate_wall([view], "d4xx").model.growth == pytest.approx(7e-4, rel=0.1)


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    calibrate.add(parser.add_subparsers())
    options = parser.parse_args(["calibrate", "depth", *arguments])
    status: int = options.main(options)
    return status


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    balls, depth = seen(BALLS, 0.03, 0.0, 1e-3)
    cv2.imwrite(str(tmp_path / "f_color.png"), np.zeros((480, 640, 3), np.uint8))
    cv2.imwrite(str(tmp_path / "f_depth_mm.png"), np.round(1e3 * depth).astype(np.uint16))
    (tmp_path / "intrinsics.yaml").write_text(
        "fx: 600 px\nfy: 600 px\ncx: 320 px\ncy: 240 px\nwidth: 640\nheight: 480\n"
    )
    rows = [f"f,{b.name},{','.join(map(str, b.box))},{1e3 * b.diameter}" for b in balls]
    (tmp_path / "balls.csv").write_text("\n".join(["frame,name,x,y,w,h,diameter_mm", *rows]) + "\n")
    return tmp_path


def test_the_command_writes_a_file_that_a_camera_takes_and_a_picture(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = folder / "depth_model.yaml", folder / "depth.png"
    table = str(folder / "balls.csv")
    assert run(str(folder), "--balls", table, "--out", str(out), "--plot", str(picture)) == 0
    said = capsys.readouterr().out
    assert "balls held out lie" in said
    model = read_depth_model(out)
    assert model.corrected(np.array([0.93], np.float32))[0] == pytest.approx(0.9, abs=0.012)
    assert cv2.imread(str(picture)) is not None


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("frame,x,y,w,h,diameter_mm\nf,1,2,30,40,60\n", "no column name"),
        ("frame,name,x,y,w,h,diameter_mm\nf,a,1,2,three,4,60\n", ":2: x, y, w, h"),
        ("frame,name,x,y,w,h,diameter_mm\nf,a,1,2,3,4,60\n", ":2: a box of 8 pixels"),
        ("frame,name,x,y,w,h,diameter_mm\nf,a,1,2,nan,40,60\n", ":2: a box of 8 pixels"),
        ("frame,name,x,y,w,h,diameter_mm\n", "holds no ball"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_its_line_and_leaves_no_file(
    folder: Path, capsys: pytest.CaptureFixture[str], table: str, says: str
) -> None:
    (folder / "balls.csv").write_text(table)
    out = folder / "model.yaml"
    assert run(str(folder), "--balls", str(folder / "balls.csv"), "--out", str(out)) == 2
    assert says in capsys.readouterr().err
    assert not out.exists()


def test_frames_without_labels_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(str(folder), "--out", str(folder / "m.yaml")) == 2
    assert "--balls TABLE or --wall" in capsys.readouterr().err
    (folder / "intrinsics.yaml").unlink()
    assert run(str(folder), "--wall", "--out", str(folder / "m.yaml")) == 2
    assert "intrinsics" in capsys.readouterr().err


def test_a_depth_model_that_is_there_is_not_written_over(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "depth_model.yaml"
    out.write_text("mine")
    assert run(str(folder), "--balls", str(folder / "balls.csv"), "--out", str(out)) == 2
    assert "depth_model.yaml is there already: name another file" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_only_rows_that_are_asked_for_are_balls(folder: Path) -> None:
    assert [ball.name for ball in read_balls(folder / "balls.csv", only="b")] == ["b"]


def test_the_noise_of_a_camera_is_measured_on_a_wall(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(5)
    wall = 1.0 / (0.8 + 0.3 * RAYS[..., 0] - 0.2 * RAYS[..., 1])

    colour = np.zeros((*wall.shape, 3), np.uint8)
    looks = []
    for number in range(calibrate.LIVE_FRAMES):
        noisy = wall + 7e-4 * wall**2 * rng.normal(size=wall.shape)
        looks.append(Frame(0.0, number, colour, noisy.astype(np.float32), CAMERA, None, np.eye(4)))
    clock = MockClock()
    cell = Cell("lab", "lab", clock, {"camera": MockCamera(*looks)})
    monkeypatch.setattr("pomona.executive.cell.connect.load_cell", lambda *_: cell)
    out = tmp_path / "model.yaml"
    assert run("--cell", "sim", "--wall", "--out", str(out)) == 0
    assert "noise" in capsys.readouterr().out
    assert out.exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--wall",), "frames are missing"),
        (("somewhere", "--cell", "sim", "--wall"), "frames are missing"),
        (("--cell", "sim", "--balls", "balls.csv"), "balls need recorded frames"),
        (("--cell", "nothing", "--wall"), "nothing"),
    ],
)
def test_unsupported_modes_of_a_live_camera_are_reported(
    arguments: tuple[str, ...], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments, "--out", str(tmp_path / "m.yaml")) == 2
    assert says in capsys.readouterr().err
