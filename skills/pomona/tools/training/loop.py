"""One training loop for all networks: resumable step by step, averaged weights, a rate that falls."""

from __future__ import annotations

import copy
import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, TypeVar

import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset, Subset

from pomona.tools.training.annotations import BadTraining
from pomona.tools.training.optimiser import Optimiser

Loss = Callable[[nn.Module, tuple[Tensor, ...]], Tensor]

Trained = TypeVar("Trained", bound=nn.Module)

Fall = Literal["cosine", "late"]

# part of the steps in which a rate falls to nothing; before it a run may be made longer
FALLING = 0.4
LARGEST_GRADIENT = 5.0  # norm to which a step's gradient is clipped
REPORT_EVERY = 25  # steps between two reports of progress


@dataclass(frozen=True, slots=True)
class Schedule:
    """Length and rates of a training."""

    steps: int  # optimiser steps in all
    rate: float = 2e-3  # highest learning rate
    # how the rate falls after the rise; "late" keeps it, and falls linearly over the last `FALLING` steps
    fall: Fall = "cosine"
    warm_up: int = 60  # steps of linear rise before it
    average: float = 0.998  # decay of the running average of weights that is kept in the end
    validate_every: int = 250  # steps between validations and checkpoints

    def rate_at(self, step: int) -> float:
        """Return the learning rate of one step."""
        if step < self.warm_up:
            return self.rate * (step + 1) / self.warm_up
        if self.fall == "late":
            return self.rate * min(1.0, (self.steps - step) / (FALLING * self.steps))
        part = (step - self.warm_up) / max(1, self.steps - self.warm_up)
        return self.rate * (0.5 + 0.5 * math.cos(math.pi * min(1.0, part))) + 1e-6


@dataclass(slots=True)
class Progress:
    """Progress of a training run."""

    step: int
    steps: int
    loss: float
    rate: float
    seconds: float
    held_out: float | None = None  # loss on frames that are not learnt from


def train_network(
    network: Trained,
    batches: Dataset[tuple[Tensor, ...]],
    loss: Loss,
    schedule: Schedule,
    checkpoint: Path,
    validate: Callable[[nn.Module], float] | None = None,
    device: str = "cpu",
    workers: int = 1,
    report: Callable[[Progress], None] | None = None,
) -> Trained:
    """Train until `schedule.steps`, going on from `checkpoint` where it exists; returns the averaged network.

    A resumed run takes the same steps as one that was never interrupted: batch k depends on its number alone, and the
    checkpoint holds weights, averages and the optimiser's state.

    Args:
        validate, report: held-out loss of the averaged network, and called now and then.
        workers: processes that prepare batches; 0 prepares them here.

    Raises BadTraining: the checkpoint belongs to another network or schedule, or the loss is no longer finite.
    """
    place = torch.device(device)
    network.to(place, memory_format=torch.channels_last).train()  # type: ignore[call-overload]
    optimiser = Optimiser(network)
    average = {k: v.detach().clone() for k, v in network.state_dict().items()}
    first = _resume(checkpoint, network, optimiser, average, schedule, place)
    remaining = Subset(batches, range(first, schedule.steps))
    on_gpu = place.type == "cuda"
    loader = DataLoader(
        remaining,
        batch_size=None,
        num_workers=workers,
        prefetch_factor=4 if workers else None,
        pin_memory=on_gpu,
    )
    low_precision = on_gpu or has_bfloat16()
    started = time.monotonic()
    mean_loss = 0.0
    for step, batch in enumerate(loader, start=first):
        on_device = tuple(part.to(place, non_blocking=True) for part in batch)
        with torch.autocast(place.type, dtype=torch.bfloat16, enabled=low_precision):
            value = loss(network, on_device)
        network.zero_grad(set_to_none=True)
        value.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(network.parameters(), LARGEST_GRADIENT)
        optimiser.step(schedule.rate_at(step))
        _update_average(average, network, min(schedule.average, (1.0 + step) / (10.0 + step)))
        current = float(value.detach())
        if not math.isfinite(current):
            raise BadTraining(
                f"the loss is {current} at step {step}; lower the learning rate and resume"
            )
        mean_loss = current if step == first else 0.97 * mean_loss + 0.03 * current
        last = step + 1 == schedule.steps
        due = last or (step + 1) % schedule.validate_every == 0
        held_out = None
        if due:
            _save(checkpoint, network, optimiser, average, step + 1, schedule)
            if validate is not None:
                held_out = validate(_averaged(network, average))
        if report is not None and (due or (step + 1) % REPORT_EVERY == 0):
            seconds = time.monotonic() - started
            rate = schedule.rate_at(step)
            report(Progress(step + 1, schedule.steps, mean_loss, rate, seconds, held_out))
    return _averaged(network, average)


def _update_average(average: dict[str, Tensor], network: nn.Module, keep: float) -> None:
    with torch.no_grad():
        for key, value in network.state_dict().items():
            if value.dtype.is_floating_point:
                average[key].lerp_(value, 1.0 - keep)
            else:
                average[key].copy_(value)


def _averaged(network: Trained, average: dict[str, Tensor]) -> Trained:
    """Return a copy of the network in evaluation mode that holds the averaged weights."""
    twin = copy.deepcopy(network)
    twin.load_state_dict(average)
    return twin.eval()


def _save(
    path: Path,
    network: nn.Module,
    optimiser: Optimiser,
    average: dict[str, Tensor],
    step: int,
    schedule: Schedule,
) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    state = {
        "network": network.state_dict(),
        "average": average,
        "optimiser": optimiser.state(),
        "step": step,
        "schedule": json.dumps(asdict(schedule)),
    }
    torch.save(state, part)
    part.replace(path)


def _resume(
    path: Path,
    network: nn.Module,
    optimiser: Optimiser,
    average: dict[str, Tensor],
    schedule: Schedule,
    place: torch.device,
) -> int:
    if not path.is_file():
        return 0
    try:
        state = torch.load(path, map_location=place, weights_only=True)
        network.load_state_dict(state["network"])
        optimiser.restore(state["optimiser"])
        for key, value in state["average"].items():
            average[key].copy_(value)
    except Exception as error:
        raise BadTraining(f"checkpoint {path} does not belong to this training: {error}") from error
    step = int(state["step"])
    saved = json.loads(state["schedule"])
    wanted = asdict(schedule)
    changed = [k for k in wanted if saved.get(k) != wanted[k] and k != "validate_every"]
    if changed == ["steps"]:
        before = Schedule(**saved)
        if step <= schedule.steps and all(
            before.rate_at(k) == schedule.rate_at(k) for k in range(step)
        ):
            changed = []  # shorter or longer, but the same so far
    if changed:
        raise BadTraining(
            f"checkpoint {path} was made with another schedule ({', '.join(changed)}); use another folder"
        )
    return step


CPU_FLAGS = Path("/proc/cpuinfo")


@lru_cache(maxsize=1)
def has_bfloat16() -> bool:
    """Return True if the processor multiplies matrices of bfloat16 (AMX); others are slower with it than with float32.

    With AVX-512's own bfloat16 and no AMX, finder and eight looks took 48 and 52 ms, in float32 38 and 36 ms.
    """
    if not CPU_FLAGS.is_file():
        return False
    flags = CPU_FLAGS.read_text(encoding="utf-8", errors="replace")
    return "amx_bf16" in flags
