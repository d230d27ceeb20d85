"""A folder of rendered frames with annotations, made by several processes; an interrupted run goes on where it was."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import cv2

from skills.detect.annotations import AnnotatedObject, Annotation, write_annotation
from skills.detect.synthetic.options import SceneOptions
from skills.detect.synthetic.scene import RenderedFrame, render_scene
from skills.fruit import FruitModel, load_fruit

CHUNK = 20
JPEG_QUALITY = 95


@dataclass(frozen=True, slots=True)
class DatasetReport:
    """How many frames a run rendered, and how many it found."""

    rendered: int
    kept: int


def frame_paths(folder: Path, index: int) -> tuple[Path, Path]:
    """Picture and annotation of frame `index`."""
    return folder / f"{index:06d}.jpg", folder / f"{index:06d}.json"


def annotate(frame: RenderedFrame, fruit: FruitModel, options: SceneOptions) -> Annotation:
    """The annotation of a rendered frame."""
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
    return Annotation(options.width, options.height, options.camera, objects, frame.decoys, frame.kind.value)


def render_dataset(
    folder: Path,
    frames: int,
    seed: int = 0,
    fruit: str = "apple",
    options: SceneOptions | None = None,
    workers: int | None = None,
    first: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> DatasetReport:
    """Render frames `first` to `first + frames` of a seed into `folder`: NNNNNN.jpg beside NNNNNN.json.

    Frame i depends on (seed, i) alone, not on the number of workers or on what was rendered before; frames that are
    there already are kept.

    Args:
        folder: made when missing.
        frames: how many.
        seed: seed of the data set; training and held-out sets take different ones.
        fruit: name in the catalogue, or path.
        options: what the scenes are made of.
        workers: processes; None for one per core.
        first: index of the first frame.
        progress: called with (frames done, frames in all).
    """
    options = options or SceneOptions()
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [i for i in range(first, first + frames) if not frame_paths(folder, i)[1].is_file()]
    kept, done = frames - len(wanted), 0
    chunks = [wanted[i : i + CHUNK] for i in range(0, len(wanted), CHUNK)]
    count = max(1, min(workers or os.cpu_count() or 1, len(chunks)))
    if count == 1:
        for chunk in chunks:
            done += _render_chunk(folder, chunk, seed, fruit, options)
            if progress is not None:
                progress(kept + done, frames)
        return DatasetReport(done, kept)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, mp_context=context) as pool:
        jobs = [pool.submit(_render_chunk, folder, chunk, seed, fruit, options) for chunk in chunks]
        for job in as_completed(jobs):
            done += job.result()
            if progress is not None:
                progress(kept + done, frames)
    return DatasetReport(done, kept)


def frame_seed(seed: int, index: int) -> int:
    """Seed of one frame's scene."""
    return seed * 10_000_000 + index


def _render_chunk(folder: Path, indices: list[int], seed: int, fruit: str, options: SceneOptions) -> int:
    cv2.setNumThreads(1)
    model = load_fruit(fruit)
    for index in indices:
        frame = render_scene(model, options, frame_seed(seed, index))
        picture, annotation = frame_paths(folder, index)
        cv2.imwrite(str(picture), frame.colour[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        write_annotation(annotation, annotate(frame, model, options))
    return len(indices)
