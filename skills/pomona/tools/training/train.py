"""Train the compact detector (or the full network) from a folder of frames."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn
from torch.utils.data import Dataset

from pomona.skills.perception.detection.close_look import AXIS, CENTRE, KIND, SIZE
from pomona.skills.perception.detection.errors import BadTraining
from pomona.tools.photographs.photographs import PhotoSet
from pomona.tools.pytorch.networks import (
    FROZEN,
    CloseLookNetwork,
    DopeNetwork,
    FinderNetwork,
    to_input,
)
from pomona.tools.training.all_reduce import CONTEXT, GradientAllReduce
from pomona.tools.training.finder_figures import finder_figures
from pomona.tools.training.finder_samples import (
    PHOTO_JITTER,
    EmptyWindows,
    FinderBatches,
    FrameWindows,
    PhotoWindows,
    Windows,
)
from pomona.tools.training.loop import Loss, Progress, Schedule, train_network
from pomona.tools.training.losses import close_look_loss, dope_loss, finder_loss
from pomona.tools.training.places import load_places
from pomona.tools.training.samples import CloseLookBatches, DopeBatches, FrameFolder

Part = Literal["finder", "close_look", "dope"]

PAPER_SCHEDULE = Schedule(
    steps=124_000,
    rate=1e-4,
    fall="constant",
    warm_up=0,
    method="adam",
    decay=0.0,
    clip=1e9,
    average=0.0,
)
"""The paper's: 120 epochs of 120 000 frames in batches of 116 at a constant rate of 1e-4 (Adam)."""


@dataclass(frozen=True, slots=True)
class TrainingRun:
    """One training run: network, data and place of its files."""

    part: Part  # the network
    data: tuple[
        tuple[Path, int], ...
    ]  # folders of annotated frames, and how many samples of a batch come from each
    held_out: Path | None  # folder of validation frames, None for none
    out: Path  # folder of checkpoints
    schedule: Schedule  # length and rates
    seed: int = 0  # of batches and first weights
    # file of where the finder proposes fruit in `data`, for the close look; None without a finder
    places: Path | None = None
    start_from: dict[str, Tensor] | None = None  # weights to begin with, None for random ones
    trained_trunk: bool = False  # the finder's trunk was trained before, and most of it is kept
    kept: int = FROZEN  # first blocks of such a trunk that keep their weights
    jitter: float = PHOTO_JITTER  # as of `PhotoWindows`
    device: str = "cpu"  # "cpu" or "cuda"
    workers: int = 1  # processes that prepare batches, for each that learns
    processes: int = 1  # that learn, each with its part of every batch
    turned: float = 0.0  # ratio of the close looks that are turned by any angle about their axis
    photographs: PhotoSet | None = (
        None  # with boxes, for the finder to learn from beside the frames, and to measure on
    )
    photos: int = 0  # photos, empty: windows of a batch that come from photographs, and from pictures without fruit
    empty: int = 0


def train_part(run: TrainingRun, report: Callable[[Progress], None] | None = None) -> nn.Module:
    """Train one network of the compact detector; resumes from `out`. Returns it with averaged weights, in eval mode.

    Raises BadTraining: as `train_network`, or a process that learns beside this one has ended.
    """
    if run.processes == 1:
        return _train(run, report)
    all_reduce = GradientAllReduce(run.processes, _PARTS[run.part][0]())
    others = [
        CONTEXT.Process(target=_follow, args=(run, all_reduce, rank))
        for rank in range(1, run.processes)
    ]
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for other in others:
            other.start()
        return _train(run, report, all_reduce)
    except BaseException:
        all_reduce.abandon()
        raise
    finally:
        torch.set_num_threads(threads)
        for other in others:
            other.join()


def _follow(run: TrainingRun, all_reduce: GradientAllReduce, rank: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the first one decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    torch.set_num_threads(1)
    try:
        _train(run, None, all_reduce, rank)
    except BadTraining:
        all_reduce.abandon()  # the first one reports it
    except BaseException:
        all_reduce.abandon()
        raise


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _train(
    run: TrainingRun,
    report: Callable[[Progress], None] | None,
    all_reduce: GradientAllReduce | None = None,
    rank: int = 0,
) -> nn.Module:
    torch.manual_seed(run.seed)
    kind, loss = _PARTS[run.part]
    network = kind()
    if run.start_from is not None:
        network.load_state_dict(run.start_from)
    slow = None
    if isinstance(network, FinderNetwork) and run.trained_trunk:
        network.keep_trunk(run.kept)
        slow = network.trunk
    batches = _finder_batches(run, rank) if run.part == "finder" else _other_batches(run, rank)
    validate = _all_figures(run) if rank == 0 else None
    checkpoint = run.out / f"{run.part}.checkpoint.pt"
    return train_network(
        network,
        batches,
        loss,
        run.schedule,
        checkpoint,
        validate,
        run.device,
        run.workers,
        report,
        all_reduce,
        rank,
        slow,
    )


def _finder_batches(run: TrainingRun, rank: int) -> FinderBatches:
    photographs = run.photographs or PhotoSet((), ())
    sources: list[tuple[Windows, int]] = [
        (FrameWindows(FrameFolder([folder]), photographs.empty), count)
        for folder, count in run.data
        if count
    ]
    if run.photos:
        sources.append((PhotoWindows(photographs.train, run.jitter), run.photos))
    if run.empty and photographs.empty:
        sources.append((EmptyWindows(photographs.empty), run.empty))
    return FinderBatches(sources, run.seed, run.schedule.steps, rank, run.processes)


def _other_batches(run: TrainingRun, rank: int) -> Dataset[tuple[Tensor, ...]]:
    frames = FrameFolder([folder for folder, _ in run.data])
    batch = sum(count for _, count in run.data) // run.processes
    seed, steps = run.seed * run.processes + rank, run.schedule.steps
    if run.part == "dope":
        return DopeBatches(frames, batch, seed, steps)
    places = None if run.places is None else load_places(run.places)
    return CloseLookBatches(frames, batch, seed, steps, places=places, turned=run.turned)


def _all_figures(run: TrainingRun) -> Callable[[nn.Module], dict[str, float]]:
    """Return figures on rendered frames and on photographs, of those that the run has."""
    if run.part == "finder":
        return finder_figures(
            None if run.held_out is None else FrameFolder([run.held_out]),
            run.photographs,
            run.device,
        )
    return (lambda network: {}) if run.held_out is None else _validation(run)


def _finder_step(network: nn.Module, batch: tuple[Tensor, ...]) -> Tensor:
    pictures, targets = batch
    return finder_loss(network(to_input(pictures)), targets)


def _dope_step(network: nn.Module, batch: tuple[Tensor, ...]) -> Tensor:
    """The paper's loss; turning the picture about the camera's axis turns the label of a symmetric fruit with it."""
    pictures, belief, affinity = batch
    beliefs, affinities = network(pictures)
    return dope_loss(list(zip(beliefs, affinities, strict=True)), belief, affinity)


def _close_look_step(network: nn.Module, batch: tuple[Tensor, ...]) -> Tensor:
    pictures, *truth = batch
    return close_look_loss(network(to_input(pictures)), *truth)


_PARTS: dict[Part, tuple[type[nn.Module], Loss]] = {
    "finder": (FinderNetwork, _finder_step),
    "close_look": (CloseLookNetwork, _close_look_step),
    "dope": (DopeNetwork, _dope_step),
}


def _validation(run: TrainingRun) -> Callable[[nn.Module], dict[str, float]]:
    assert run.held_out is not None
    frames = FrameFolder([run.held_out])
    if run.part == "dope":
        batch = min(len(frames), 2)
        map_batches = DopeBatches(frames, batch, 0, min(5, len(frames) // batch), augment=False)

        def map_figures(network: nn.Module) -> dict[str, float]:
            total = 0.0
            with torch.no_grad():
                for k in range(len(map_batches)):
                    total += float(_dope_step(network, _on(run.device, map_batches[k])))
            return {"held-out loss": total / len(map_batches)}

        return map_figures
    look_batches = CloseLookBatches(
        frames, min(200, 8 * len(frames)), 0, 1 + min(3, len(frames) // 25), augment=False
    )
    fixed = [look_batches[k] for k in range(len(look_batches))]

    def look_figures(network: nn.Module) -> dict[str, float]:
        loss, wrong, count = 0.0, 0.0, 0
        errors = []
        with torch.no_grad():
            for batch in fixed:
                pictures, target, kind, visibility = _on(run.device, batch)
                output = network(to_input(pictures)).float()
                loss += float(close_look_loss(output, target, kind, visibility)) / len(fixed)
                clear = (kind > 0.5) & (visibility > 0.6)
                axis = nn.functional.normalize(output[clear, AXIS], dim=1)
                cosine = (axis * target[clear, 3:6]).sum(dim=1).clamp(-1.0, 1.0)
                centre = (output[clear, CENTRE] - target[clear, :2]).norm(dim=1)
                size = (output[clear, SIZE] - target[clear, 2]).abs()
                errors.append(
                    torch.stack([torch.rad2deg(torch.acos(cosine)), 100.0 * centre, 100.0 * size])
                )
                wrong += float(((output[:, KIND] > 0.0) != (kind > 0.5)).sum())
                count += len(kind)
        axis, centre, size = torch.cat(errors, dim=1)
        return {
            "held-out loss": loss,
            "axis median deg": float(axis.median()),
            "axis p90 deg": float(axis.quantile(0.9)),
            "centroid median %": float(centre.median()),
            "size median %": float(size.median()),
            "wrong kind %": 100.0 * wrong / count,
        }

    return look_figures


def _on(device: str, batch: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    return tuple(part.to(device) for part in batch)
