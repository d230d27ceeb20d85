"""LeRobot itself reads Pomona's datasets, in its own environment and without a network; its checker finds no errors."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from recorded_motion import record_motion

pytest.importorskip("pyarrow", reason="the extra lerobot (pyarrow, 55 MB) is not installed")

from pomona.tools.exchange.episode import read_episode
from pomona.tools.exchange.lerobot import export_lerobot

HOME = Path(__file__).parents[4]
THEIRS = HOME / ".lerobot" / "bin"

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not (THEIRS / "python").exists(),
        reason="make lerobot-env first: LeRobot pins another torch",
    ),
]


def theirs(*words: str, cwd: Path) -> str:
    offline = {
        "HF_HUB_OFFLINE": "1",
        "HF_DATASETS_OFFLINE": "1",
        "HF_HOME": str(cwd / "hf"),
        "NO_COLOR": "1",
    }
    done = subprocess.run(
        words, cwd=cwd, env=os.environ | offline, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_lerobot_reads_every_value_as_the_record_has_it(tmp_path: Path) -> None:
    records = [record_motion(tmp_path / "one"), record_motion(tmp_path / "two", outcome="failure")]
    export_lerobot(records, tmp_path / "dataset", 20, "reach out")
    reader = str(Path(__file__).with_name("lerobot_reads.py"))
    theirs(
        str(THEIRS / "python"),
        reader,
        str(tmp_path / "dataset"),
        str(tmp_path / "out.npz"),
        cwd=tmp_path,
    )
    read = np.load(tmp_path / "out.npz")
    episodes = [read_episode(record, 20) for record in records]
    state = np.concatenate([episode.state for episode in episodes]).astype(np.float32)
    assert np.array_equal(read["observation.state"], state)
    assert np.array_equal(read["batched_state"], state[:8])
    assert np.array_equal(
        read["action"], np.concatenate([episode.action for episode in episodes]).astype(np.float32)
    )
    assert np.array_equal(
        read["observation.wrench"],
        np.concatenate([episode.wrench for episode in episodes]).astype(np.float32),
    )
    assert np.allclose(read["mean_of_state"], state.astype(float).mean(0), atol=1e-7)
    assert (int(read["fps"]), int(read["episodes"])) == (20, 2)
    assert set(read["task"]) == {"reach out"}
    assert read["next.success"].sum() == 1
    at, files = episodes[0].depth
    depth = cv2.imdecode(np.frombuffer(files[at[0]], np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(read["observation.depth.camera"][0, 0], depth)
    colour = cv2.imdecode(np.frombuffer(episodes[0].colour[1][0], np.uint8), cv2.IMREAD_COLOR)[
        ..., ::-1
    ]
    seen = read["observation.images.camera"][0].transpose(1, 2, 0) * 255.0
    assert np.abs(seen - colour).max() <= 2.0  # two decoders of one JPEG


def test_an_independent_checker_finds_nothing_wrong(tmp_path: Path) -> None:
    export_lerobot([record_motion(tmp_path / "one", end=3.0)], tmp_path / "dataset", 20)
    said = theirs(str(THEIRS / "lerobot-doctor"), str(tmp_path / "dataset"), "--json", cwd=tmp_path)
    report = json.loads(said[said.index("{") :])
    assert report["summary"]["FAIL"] == 0, said
    short = "Episode Health"  # sixty steps are few for some policies
    assert all(
        check["severity"] == "PASS" for check in report["checks"] if check["name"] != short
    ), said
