"""Records as a dataset of LeRobot, version 3: tables in Parquet, images as they were recorded, no video.

A JPEG and a 16-bit PNG stand in the table as they stand in the record, so every pixel comes back as it was.
pomona/tools/ros2/interop.md has every feature with its unit.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.errors import UsageError
from pomona.executive.images import from_file
from pomona.executive.recording.plain_file import made_whole
from pomona.executive.values.installation import need
from pomona.tools.exchange.episode import Episode, read_episode

EXTRA = "lerobot"
VERSION = "v3.0"
RATE = 10  # default step rate [1/s]
MOST = 1000  # steps a second: no device of a record measures more often
CHUNK = 1000  # files in a folder
ROWS = 200  # of a group in a table: a look that many steps share is stored once in each group
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
# images and pixels of them from which their statistics are made
STATED_LOOKS = 10
STATED_STEP = 4

STATE = "observation.state"
WRENCH = "observation.wrench"
ACTION = "action"
COLOUR = "observation.images.camera"
DEPTH = "observation.depth.camera"
SUCCESS = "next.success"
DONE = "next.done"
_SCALARS = {SUCCESS: "bool", DONE: "bool", "timestamp": "float32"} | dict.fromkeys(
    ("frame_index", "episode_index", "index", "task_index"), "int64"
)
_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"


def export_lerobot(
    records: Sequence[Path], folder: Path, rate: int = RATE, task: str = ""
) -> Mapping[str, str]:
    """Write records as a dataset, one episode each.

    Args:
        records: folders or files.
        folder: of the dataset; there must be none yet.
        rate: steps a second.
        task: description of the task; by default the tree's name.

    Returns:
        the number of episodes and the names of the features.

    Raises UsageError: the extra is missing, the rate is invalid, the folder exists or cannot be written, or a record
    cannot be read or has other features than the first.
    """
    pyarrow = need("pyarrow", EXTRA, "a dataset of LeRobot")
    need("pyarrow.parquet", EXTRA, "a dataset of LeRobot")
    if not records:
        raise UsageError("no record to write")
    if not 0 < rate <= MOST:
        raise UsageError(f"{rate} steps a second: it must be 1 to {MOST}")
    with made_whole(folder) as place:
        dataset = _Dataset(pyarrow, place, rate)
        for record in records:
            episode = read_episode(record, rate)
            dataset.add(episode, task or episode.tree.replace("_", " "))
        dataset.finish()
    return dataset.described()


class _Dataset:
    """A dataset that is being written."""

    def __init__(self, pyarrow: Any, folder: Path, rate: int) -> None:
        self._pa = pyarrow
        self._folder = folder
        self._rate = rate
        self._features: dict[str, dict[str, Any]] = {}
        self._tasks: list[str] = []
        self._episodes: list[dict[str, Any]] = []
        self._stats: list[dict[str, dict[str, Any]]] = []
        self._frames = 0

    def add(self, episode: Episode, task: str) -> None:
        features = _features(episode, self._rate)
        if not self._features:
            self._features = features
        elif features != self._features:
            keys = {**features, **self._features}
            other = ", ".join(k for k in keys if features.get(k) != self._features.get(k))
            raise UsageError(f"{episode.name} has other features than the first record: {other}")
        if task not in self._tasks:
            self._tasks.append(task)
        number = len(self._episodes)
        count = len(episode.times)
        columns = _columns(episode) | {
            "timestamp": (np.arange(count) / self._rate).astype(np.float32),
            "frame_index": np.arange(count),
            "episode_index": np.full(count, number),
            "index": self._frames + np.arange(count),
            "task_index": np.full(count, self._tasks.index(task)),
        }
        chunk, file = divmod(number, CHUNK)
        path = self._folder / _DATA.format(chunk_index=chunk, file_index=file)
        self._write_frames(path, episode, columns)
        stats = {key: _stats(values) for key, values in columns.items()} | dict(
            _image_stats(episode)
        )
        self._stats.append(stats)
        self._episodes.append(
            {
                "episode_index": number,
                "tasks": [task],
                "length": count,
                "data/chunk_index": chunk,
                "data/file_index": file,
                "dataset_from_index": self._frames,
                "dataset_to_index": self._frames + count,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                "record": episode.name,
                "success": episode.succeeded,
                **{
                    f"stats/{key}/{name}": value
                    for key, about in stats.items()
                    for name, value in about.items()
                },
            }
        )
        self._frames += count

    def finish(self) -> None:
        pa = self._pa
        info = {
            "codebase_version": VERSION,
            "robot_type": "pomona",
            "total_episodes": len(self._episodes),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": self._rate,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": _DATA,
            "video_path": None,
            "features": self._features,
        }
        meta = self._folder / "meta"
        chunk = meta / "episodes" / "chunk-000"
        chunk.mkdir(parents=True)
        _write_json(meta / "info.json", info)
        _write_json(meta / "stats.json", _merged(self._stats))
        write = pa.parquet.write_table
        write(pa.Table.from_pylist(self._episodes), chunk / "file-000.parquet")
        tasks = pa.table({"task_index": list(range(len(self._tasks))), "task": self._tasks})
        index = {"pandas": json.dumps(_INDEX_OF_TASKS)}
        write(tasks.replace_schema_metadata(index), meta / "tasks.parquet")

    def described(self) -> Mapping[str, str]:
        return {
            "episodes": f"{len(self._episodes)}, {self._frames} frames at {self._rate} Hz",
            "features": ", ".join(self._features),
        }

    def _write_frames(self, path: Path, episode: Episode, columns: Mapping[str, Any]) -> None:
        """Write the steps in groups, so that a long episode is never in memory as a whole."""
        path.parent.mkdir(parents=True, exist_ok=True)
        schema = self._table(episode, columns, slice(ROWS)).schema
        # bytes of the distinct images of a group that are stored once each
        distinct = 64 << 20
        with self._pa.parquet.ParquetWriter(
            path, schema, dictionary_pagesize_limit=distinct
        ) as writer:
            for begin in range(0, len(episode.times), ROWS):
                writer.write_table(self._table(episode, columns, slice(begin, begin + ROWS)))

    def _table(self, episode: Episode, columns: Mapping[str, Any], rows: slice) -> Any:
        pa = self._pa
        arrays = {key: _arrow(pa, values[rows]) for key, values in columns.items()}
        image = pa.struct({"bytes": pa.binary(), "path": pa.string()})
        for key, (at, files) in _looks(episode).items():
            coded = [{"bytes": files[k], "path": None} for k in at[rows]]
            arrays[key] = pa.array(coded, image)
        return pa.table({key: arrays[key] for key in self._features})


_TASK_COLUMNS = (("task_index", "int64", "int64"), ("task", "unicode", "object"))
_INDEX_OF_TASKS = {
    "index_columns": ["task"],
    "column_indexes": [],
    "columns": [
        {
            "name": name,
            "field_name": name,
            "pandas_type": pandas,
            "numpy_type": kind,
            "metadata": None,
        }
        for name, pandas, kind in _TASK_COLUMNS
    ],
    "pandas_version": "2.0.0",
}
"""LeRobot reads this table with pandas and looks tasks up by their words."""


def _features(episode: Episode, rate: int) -> dict[str, dict[str, Any]]:
    found = {STATE: _vector(episode.state_names), ACTION: _vector(episode.state_names)}
    if episode.wrench is not None:
        found[WRENCH] = _vector(episode.wrench_names)
    if episode.size is not None:
        width, height = episode.size
        image = {"dtype": "image", "names": ["height", "width", "channels"]}
        found[COLOUR] = {**image, "shape": [height, width, 3]}
        found[DEPTH] = {**image, "shape": [height, width, 1], "info": {"unit": "mm"}}
    for key, kind in _SCALARS.items():
        found[key] = {"dtype": kind, "shape": [1], "names": None}
    return {key: {**about, "fps": rate} for key, about in found.items()}


def _vector(names: Sequence[str]) -> dict[str, Any]:
    return {"dtype": "float32", "shape": [len(names)], "names": list(names)}


def _looks(episode: Episode) -> dict[str, tuple[NDArray[np.int64], list[bytes]]]:
    """Return the images of each step, by feature: indices into a list of coded files."""
    looks = {COLOUR: episode.colour, DEPTH: episode.depth}
    return {key: look for key, look in looks.items() if look is not None}


def _columns(episode: Episode) -> dict[str, NDArray[Any]]:
    last = np.arange(len(episode.times)) == len(episode.times) - 1
    columns = {STATE: episode.state.astype(np.float32), ACTION: episode.action.astype(np.float32)}
    if episode.wrench is not None:
        columns[WRENCH] = episode.wrench.astype(np.float32)
    return {**columns, SUCCESS: last & episode.succeeded, DONE: last}


def _arrow(pa: Any, values: NDArray[Any]) -> Any:
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), values.shape[1])


# ------------------------------------------------------------------------------------------------ statistics


def _stats(values: NDArray[Any]) -> dict[str, Any]:
    """Of a column, over its rows."""
    rows = np.asarray(values, np.float64).reshape(len(values), -1)
    return _described(rows, len(rows), (-1,))


def _image_stats(episode: Episode) -> Iterator[tuple[str, dict[str, Any]]]:
    """Of a few looks, by channel: colour from 0 to 1, depth in millimetres, shape (c, 1, 1)."""
    for key, (at, files) in _looks(episode).items():
        seen = np.unique(at)
        chosen = seen[:: -(-len(seen) // STATED_LOOKS)]
        try:
            small = [from_file(files[k])[::STATED_STEP, ::STATED_STEP] for k in chosen]
            pixels = np.stack(small).reshape(-1, 3 if key == COLOUR else 1)
        except ValueError as error:
            raise UsageError(f"{episode.name}: {error}") from error
        rows = pixels / (255.0 if key == COLOUR else 1.0)
        yield key, _described(rows, len(small), (-1, 1, 1))


def _described(rows: NDArray[np.float64], count: int, shape: tuple[int, ...]) -> dict[str, Any]:
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    found |= {name: np.quantile(rows, share, axis=0) for name, share in QUANTILES.items()}
    return {name: row.reshape(shape).tolist() for name, row in found.items()} | {"count": [count]}


def _merged(stats: Sequence[Mapping[str, Mapping[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Of all episodes together; quantiles are averages, as LeRobot's own."""
    merged = {}
    for key in stats[0]:
        of = {name: np.array([one[key][name] for one in stats]) for name in stats[0][key]}
        counts = of.pop("count")[:, 0]
        found = {name: np.average(of[name], axis=0, weights=counts) for name in of}
        spread = of["std"] ** 2 + (of["mean"] - found["mean"]) ** 2
        found["min"] = of["min"].min(0)
        found["max"] = of["max"].max(0)
        found["std"] = np.sqrt(np.average(spread, axis=0, weights=counts))
        merged[key] = {name: value.tolist() for name, value in found.items()}
        merged[key]["count"] = [int(counts.sum())]
    return merged


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=4, ensure_ascii=False), encoding="utf-8")
