"""A folder of rendered frames with annotations, made by several processes; an interrupted run goes on where it was."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2

from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.tools.library.pool import WorkerPool, one_per_core
from pomona.tools.training.annotations import AnnotatedObject, Annotation, write_annotation
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.scene import RenderedFrame, render_scene

CHUNK = 20

Rendered = tuple[int, bytes, Annotation]  # index of a frame, its JPEG file and its annotation


@dataclass(frozen=True, slots=True)
class DatasetReport:
    """How many frames a run rendered, and how many it found."""

    rendered: int
    kept: int


def frame_paths(folder: Path, index: int) -> tuple[Path, Path]:
    """Picture and annotation of frame `index`."""
    return folder / f"{index:06d}.jpg", folder / f"{index:06d}.json"


def annotate(frame: RenderedFrame, fruit: FruitModel, options: SceneOptions) -> Annotation:
    """Return the annotation of a rendered frame."""
    objects = tuple(
        AnnotatedObject(
            fruit.name,
            truth.visibility,
            truth.T_camera_object,
            truth.keypoints,
            truth.scale,
            truth.dimensions,
            truth.box,
        )
        for truth in frame.fruit
    )
    return Annotation(
        options.width, options.height, options.camera, objects, frame.decoys, frame.kind.value
    )


def render_dataset(
    folder: Path,
    frames: int,
    seed: int = 0,
    fruit: str = "apple",
    options: SceneOptions | None = None,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DatasetReport:
    """Render `frames` frames of a seed into `folder`: NNNNNN.jpg beside NNNNNN.json.

    Frame i depends on (seed, i) alone; frames that are there already are kept.

    Args:
        fruit: name in the catalogue, or path.
        workers: processes on this machine; None for one per core.
        progress: called with (frames done, frames in all).
    """
    options = options or SceneOptions()
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [i for i in range(frames) if not frame_paths(folder, i)[1].is_file()]
    kept = frames - len(wanted)
    done = 0
    orders = [(wanted[i : i + CHUNK], seed, fruit, options) for i in range(0, len(wanted), CHUNK)]
    for chunk in _rendered(orders, workers):
        for index, picture, annotation in chunk:
            picture_path, annotation_path = frame_paths(folder, index)
            picture_path.write_bytes(picture)
            write_annotation(annotation_path, annotation)
        done += len(chunk)
        if progress is not None:
            progress(kept + done, frames)
    return DatasetReport(done, kept)


def _rendered(
    orders: list[tuple[list[int], int, str, SceneOptions]],
    workers: int | None,
) -> Iterator[list[Rendered]]:
    """Yield the chunks as they are done: in this process when one is enough."""
    count = min(workers or one_per_core(), len(orders))
    if count <= 1:
        for order in orders:
            yield render_chunk(*order)
        return
    with contextlib.closing(WorkerPool(count)) as pool:
        # seconds after which a chunk that is not done is given up
        for _index, answer in pool.map(render_chunk, orders, 1800.0):
            if isinstance(answer, BaseException):
                raise answer
            yield answer


def frame_seed(seed: int, index: int) -> int:
    """Seed of one frame's scene."""
    return seed * 10_000_000 + index


def render_chunk(
    indices: list[int], seed: int, fruit: str, options: SceneOptions
) -> list[Rendered]:
    """Render some frames: their indices, JPEG files and annotations. Writes nothing."""
    cv2.setNumThreads(1)
    model = load_fruit(fruit)
    rendered = []
    for index in indices:
        frame = render_scene(model, options, frame_seed(seed, index))
        _, picture = cv2.imencode(".jpg", frame.colour[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])
        rendered.append((index, picture.tobytes(), annotate(frame, model, options)))
    return rendered
