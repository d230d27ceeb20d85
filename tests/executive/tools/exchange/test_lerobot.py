"""Records as a dataset of LeRobot, read back with nothing of ours; test_lerobot_itself.py reads it with LeRobot."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_motion import record_motion

pytest.importorskip("pyarrow", reason="the extra lerobot (pyarrow, 55 MB) is not installed")

from pyarrow import parquet

from pomona.executive.cli import main
from pomona.tools.exchange.episode import read_episode
from pomona.tools.exchange.lerobot import export_lerobot


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Path]:
    root = tmp_path_factory.mktemp("records")
    records = [record_motion(root / "one"), record_motion(root / "two", outcome="failure", end=1.5)]
    export_lerobot(records, root / "dataset", 20, "reach out")
    return records, root / "dataset"


def table(dataset: Path, name: str) -> Any:
    return parquet.read_table(dataset / name)


def test_values_come_back_as_the_record_has_them(made: tuple[list[Path], Path]) -> None:
    records, dataset = made
    for number, record in enumerate(records):
        episode = read_episode(record, 20)
        rows = table(dataset, f"data/chunk-000/file-{number:03d}.parquet").to_pydict()
        for key, expected in (
            ("observation.state", episode.state),
            ("observation.wrench", episode.wrench),
            ("action", episode.action),
        ):
            assert np.array_equal(np.array(rows[key], np.float32), expected.astype(np.float32)), key
        for key, (at, files) in (
            ("observation.images.camera", episode.colour),
            ("observation.depth.camera", episode.depth),
        ):
            assert [image["bytes"] for image in rows[key]] == [files[k] for k in at], key
        assert rows["next.done"] == [False] * (len(at) - 1) + [True]
        assert rows["next.success"] == [False] * (len(at) - 1) + [number == 0]


def test_a_look_that_many_steps_share_is_stored_once(made: tuple[list[Path], Path]) -> None:
    rows = parquet.read_metadata(made[1] / "data/chunk-000/file-000.parquet").row_group(0)
    sizes = {
        rows.column(k).path_in_schema: rows.column(k).total_uncompressed_size
        for k in range(rows.num_columns)
    }
    _at, files = read_episode(made[0][0], 20).depth
    assert sizes["observation.depth.camera.bytes"] < 1.2 * sum(map(len, files))


def test_the_metadata_of_the_dataset_fit_to_it(made: tuple[list[Path], Path]) -> None:
    _records, dataset = made
    info = json.loads((dataset / "meta/info.json").read_text())
    episodes = table(dataset, "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    tasks = table(dataset, "meta/tasks.parquet").to_pylist()
    assert (info["codebase_version"], info["fps"], info["total_episodes"], info["total_tasks"]) == (
        "v3.0",
        20,
        2,
        1,
    )
    assert tasks == [{"task_index": 0, "task": "reach out"}]
    assert (
        info["total_frames"]
        == sum(episode["length"] for episode in episodes)
        == episodes[-1]["dataset_to_index"]
    )
    index = 0
    for episode in episodes:
        name = info["data_path"].format(
            chunk_index=episode["data/chunk_index"], file_index=episode["data/file_index"]
        )
        rows = table(dataset, name)
        assert rows.column_names == list(info["features"])
        assert rows["index"].to_pylist() == list(range(index, index + episode["length"]))
        assert set(rows["episode_index"].to_pylist()) == {episode["episode_index"]}
        assert np.allclose(np.diff(rows["timestamp"].to_numpy()), 0.05)
        index += episode["length"]
    assert [episode["success"] for episode in episodes] == [True, False]


def test_statistics_are_those_of_all_rows(made: tuple[list[Path], Path]) -> None:
    _records, dataset = made
    stats = json.loads((dataset / "meta/stats.json").read_text())
    files = sorted(dataset.glob("data/*/*.parquet"))
    rows = np.concatenate(
        [np.array(parquet.read_table(f)["observation.wrench"].to_pylist()) for f in files]
    )
    for name, expected in (
        ("min", rows.min(0)),
        ("max", rows.max(0)),
        ("mean", rows.mean(0)),
        ("std", rows.std(0)),
    ):
        assert np.allclose(stats["observation.wrench"][name], expected, atol=1e-9), name
    assert stats["observation.wrench"]["count"] == [len(rows)]
    assert np.shape(stats["observation.images.camera"]["mean"]) == (3, 1, 1)
    assert 0.2 < stats["observation.depth.camera"]["min"][0][0][0] / 1e3 < 3.0


def test_an_existing_folder_is_left_alone_and_mismatches_are_named(
    made: tuple[list[Path], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    records, dataset = made
    before = (dataset / "meta/info.json").read_bytes()
    export = ["runs", "export", str(records[0])]
    assert main([*export, str(dataset), "--to", "lerobot"]) == 2
    assert "exists, and nothing" in capsys.readouterr().err
    assert (dataset / "meta/info.json").read_bytes() == before
    blind = record_motion(tmp_path / "blind", looks=(), end=0.5)
    assert main([*export, str(tmp_path / "mixed"), "--to", "lerobot", "--with", str(blind)]) == 2
    assert (
        "blind has other features than the first record: observation.images.camera"
        in capsys.readouterr().err
    )
    assert main([*export, str(tmp_path / "x.zip"), "--rate", "20"]) == 2
    capsys.readouterr()
    assert main([*export, str(tmp_path / "often"), "--to", "lerobot", "--rate", "100000000"]) == 2
    assert "100000000 steps a second: it must be 1 to 1000" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*export, str(tmp_path / "never"), "--to", "lerobot", "--rate", "0"])
    assert "it is 0, but must be at least 1" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["blind"]
    assert main([*export, str(tmp_path / "good"), "--to", "lerobot", "--rate", "5"]) == 0
    assert "observation.state" in capsys.readouterr().out
