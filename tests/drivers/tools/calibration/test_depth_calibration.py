"""A depth model from balls: against sensors of known errors, and insufficient data."""

import argparse
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pomona.devices.frames.folder import read_depth_model
from pomona.drivers.interfaces import Intrinsics
from pomona.tools.calibration import command_calibrate as calibrate
from pomona.tools.calibration.depth_calibration import (
    Ball,
    UnusableDepth,
    calibrate_balls,
    look_at_ball,
    read_balls,
)

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


def test_the_command_writes_a_file_that_a_camera_takes(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "depth_model.yaml"
    table = str(folder / "balls.csv")
    assert run(str(folder), "--balls", table, "--out", str(out)) == 0
    said = capsys.readouterr().out
    assert "balls held out lie" in said
    model = read_depth_model(out)
    assert model.corrected(np.array([0.93], np.float32))[0] == pytest.approx(0.9, abs=0.012)


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


def test_frames_without_intrinsics_are_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "intrinsics.yaml").unlink()
    table = str(folder / "balls.csv")
    assert run(str(folder), "--balls", table, "--out", str(folder / "m.yaml")) == 2
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
