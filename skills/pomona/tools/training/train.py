"""Train one network of the compact detector from folders of frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn
from torch.utils.data import Dataset

from pomona.tools.pytorch.networks import to_input
from pomona.tools.training.finder_samples import FinderBatches
from pomona.tools.training.loop import Loss, Progress, Schedule, Trained, train_network
from pomona.tools.training.losses import close_look_loss, finder_loss
from pomona.tools.training.places import load_places
from pomona.tools.training.samples import CloseLookBatches, FrameFolder

Part = Literal["finder", "close_look"]

HELD_OUT = {"finder": (8, 4), "close_look": (200, 4)}
"""Samples of a batch, and batches, on which the held-out loss is measured."""


@dataclass(frozen=True, slots=True)
class TrainingRun:
    """One training run: network, data and place of its files."""

    part: Part  # the network
    data: tuple[tuple[Path, int], ...]  # folders of frames, and samples of a batch from each
    out: Path  # folder of checkpoints
    schedule: Schedule  # length and rates
    held_out: Path | None = None  # folder of validation frames
    seed: int = 0  # of batches
    # file of where the finder proposes fruit in `data`, for the close look; None without a finder
    places: Path | None = None
    device: str = "cpu"  # "cpu" or "cuda"
    workers: int = 1  # processes that prepare batches
    turned: float = 0.0  # ratio of the close looks that are turned by any angle about their axis


def train_part(
    run: TrainingRun, network: Trained, report: Callable[[Progress], None] | None = None
) -> Trained:
    """Train a network, which changes; resumes from `run.out`. Returns it with averaged weights, in eval mode.

    Raises BadTraining: as `train_network`.
    """
    torch.manual_seed(run.seed)
    return train_network(
        network,
        _batches(run),
        _LOSSES[run.part],
        run.schedule,
        run.out / f"{run.part}.checkpoint.pt",
        None if run.held_out is None else _held_out_loss(run, run.held_out),
        run.device,
        run.workers,
        report,
    )


def _batches(run: TrainingRun) -> Dataset[tuple[Tensor, ...]]:
    if run.part == "finder":
        sources = [(FrameFolder([folder]), count) for folder, count in run.data]
        return FinderBatches(sources, run.seed, run.schedule.steps)
    frames = FrameFolder([folder for folder, _ in run.data])
    batch = sum(count for _, count in run.data)
    places = None if run.places is None else load_places(run.places)
    return CloseLookBatches(
        frames, batch, run.seed, run.schedule.steps, places=places, turned=run.turned
    )


def _held_out_loss(run: TrainingRun, folder: Path) -> Callable[[nn.Module], float]:
    frames = FrameFolder([folder])
    batch, count = HELD_OUT[run.part]
    batches: Dataset[tuple[Tensor, ...]]
    if run.part == "finder":
        batches = FinderBatches([(frames, batch)], 0, count)
    else:
        batches = CloseLookBatches(frames, batch, 0, count, augment=False)
    fixed = [batches[k] for k in range(count)]

    def measure(network: nn.Module) -> float:
        with torch.no_grad():
            losses = [
                float(_LOSSES[run.part](network, tuple(part.to(run.device) for part in one)))
                for one in fixed
            ]
        return sum(losses) / count

    return measure


def _finder_step(network: nn.Module, batch: tuple[Tensor, ...]) -> Tensor:
    pictures, targets = batch
    return finder_loss(network(to_input(pictures)), targets)


def _close_look_step(network: nn.Module, batch: tuple[Tensor, ...]) -> Tensor:
    pictures, *truth = batch
    return close_look_loss(network(to_input(pictures)), *truth)


_LOSSES: dict[Part, Loss] = {"finder": _finder_step, "close_look": _close_look_step}
