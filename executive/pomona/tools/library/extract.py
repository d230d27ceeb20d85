"""Content of a record for other tools: images as PNG, measurements as CSV, paths as JSON.

A cell of recorded frames (trees/cells/frames.yaml) reads the folder of images:

    frames/0001_detection_color.png, frames/0001_detection_depth_mm.png, frames/intrinsics.yaml
    frames/frames.json                  time, intrinsics and camera pose of each
    images/0002_refine.png              images without depth
    fingers.csv, arm.csv, gripper.csv   one row per sample, one file per device
    series_grip.csv                     one row per sample of a plot
    paths.json                          lines in the base frame [m]: planned, approach, executed
    table_measured.csv                  the last state of a table
"""

from __future__ import annotations

import csv
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.images import to_png
from pomona.executive.recording.folder import DEVICES, events_file
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.recording.read import read_events
from pomona.executive.recording.scan import scan
from pomona.executive.recording.well_known import SERIES_TOPIC, plain_name
from pomona.executive.running.events import Event, Published
from pomona.executive.views import ImageView, PosesView, SceneView, TableView


def extract(record: Path, folder: Path) -> dict[str, str]:
    """Write all content into a folder; return the content of each written file or folder, by its name.

    Raises UsageError: the folder exists and is not empty, cannot be written, or the record cannot be read.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(
            f"{folder} exists and is not empty, and nothing is overwritten: name another folder"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = _Taken(folder)
        for event in read_events(record):
            taken.take(event)
        return {**taken.finish(), **_measurements(record, folder)}
    except OSError as error:
        raise UsageError(f"{error.filename or folder}: {error.strerror or error}") from error
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise UsageError(f"{record}: its content cannot be extracted: {error}") from error


class _Taken:
    """Writes images and paths in their order."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._frames: list[dict[str, Any]] = []
        self._images = 0
        self._paths: list[dict[str, Any]] = []
        self._traces: dict[str, list[list[float]]] = defaultdict(list)
        self._tables: dict[str, TableView] = {}

    def take(self, event: Event) -> None:
        if not isinstance(event, Published):
            return
        if isinstance(event.value, ImageView) and event.value.image is not None:
            self._take_image(event.t, event.topic, event.value)
        elif isinstance(event.value, SceneView):
            for line in event.value.lines:
                about = {
                    "t": event.t,
                    "topic": event.topic,
                    "label": line.label,
                    "style": line.style,
                }
                self._paths.append({**about, "points": line.points.tolist()})
        elif isinstance(event.value, PosesView):
            self._traces[event.topic].append([event.t, *np.asarray(event.value.trace).tolist()])
        elif isinstance(event.value, TableView):
            self._tables[event.topic] = event.value

    def _take_image(self, t: float, topic: str, view: ImageView) -> None:
        assert view.image is not None
        label = f"{len(self._frames) + self._images + 1:04d}_{plain_name(topic)}"
        if view.depth is None:
            self._images += 1
            _write_png(self._folder / "images" / f"{label}.png", view.image)
            return
        frames = self._folder / "frames"
        _write_png(frames / f"{label}_color.png", view.image)
        _write_png(frames / f"{label}_depth_mm.png", np.rint(view.depth * 1e3).astype(np.uint16))
        height, width = view.image.shape[:2]
        frame: dict[str, Any] = {
            "label": label,
            "t": t,
            "caption": view.caption,
            "width": width,
            "height": height,
        }
        if view.pinhole is not None:
            frame |= {name: getattr(view.pinhole, name) for name in ("fx", "fy", "cx", "cy")}
            T = view.pinhole.T_base_camera
            frame["T_base_camera"] = None if T is None else np.asarray(T).tolist()
        self._frames.append(frame)

    def finish(self) -> dict[str, str]:
        written = {}
        if self._frames:
            _write_json(self._folder / "frames" / "frames.json", self._frames)
            if "fx" in self._frames[0]:
                first = self._frames[0]
                text = "".join(f"{key}: {first[key]} px\n" for key in ("fx", "fy", "cx", "cy"))
                text += "".join(f"{key}: {first[key]}\n" for key in ("width", "height"))
                (self._folder / "frames" / "intrinsics.yaml").write_text(text, encoding="utf-8")
            written["frames/"] = f"{len(self._frames)} with depth, intrinsics and camera poses"
        if self._images:
            written["images/"] = f"{self._images} without depth"
        for topic, trace in self._traces.items():
            columns = np.array(trace)
            about = {"t": trace[0][0], "topic": topic, "label": "executed", "style": "executed"}
            self._paths.append(
                {**about, "times": columns[:, 0].tolist(), "points": columns[:, 1:].tolist()}
            )
        if self._paths:
            _write_json(self._folder / "paths.json", self._paths)
            labels = ", ".join(dict.fromkeys(path["label"] for path in self._paths))
            written["paths.json"] = f"lines in the base frame: {labels}"
        for topic, table in self._tables.items():
            name = f"table_{plain_name(topic)}.csv"
            with (self._folder / name).open("w", newline="", encoding="utf-8") as stream:
                csv.writer(stream).writerows((table.columns, *table.rows))
            written[name] = table.caption or f"{len(table.rows)} rows"
        return written


def _measurements(record: Path, folder: Path) -> dict[str, str]:
    rows: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for topic, content, *_ in scan(events_file(record)):
        if topic.startswith(DEVICES):
            reading = parse_object(content)
            columns = {
                name: values for name, values in reading.items() if name not in ("t", "tick")
            }
            rows[plain_name(topic.removeprefix(DEVICES))].extend(_by_row(columns))
        elif topic.startswith(SERIES_TOPIC):
            rows[f"series_{plain_name(topic.removeprefix(SERIES_TOPIC))}"].append(
                {
                    "stamp_s" if name == "t" else name: value
                    for name, value in parse_object(content).items()
                }
            )
    for name, samples in rows.items():
        _write_csv(folder / f"{name}.csv", samples)
    return {
        f"{name}.csv": f"{len(samples)} samples of {_quantities(samples[0])}"
        for name, samples in rows.items()
    }


def _by_row(columns: Mapping[str, Any]) -> Iterable[Mapping[str, Any]]:
    lists = {
        name: values if isinstance(values, list) else [values] for name, values in columns.items()
    }
    return (dict(zip(lists, values, strict=True)) for values in zip(*lists.values(), strict=True))


def _quantities(sample: Mapping[str, Any]) -> str:
    names = [name for name in sample if name != "stamp_s"]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _write_csv(path: Path, samples: Sequence[Mapping[str, Any]]) -> None:
    names = list(dict.fromkeys(name for sample in samples for name in sample))
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, names)
        writer.writeheader()
        writer.writerows(samples)


def _write_png(path: Path, image: np.ndarray[Any, Any]) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(to_png(image))


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, ensure_ascii=False, indent=1), encoding="utf-8")
