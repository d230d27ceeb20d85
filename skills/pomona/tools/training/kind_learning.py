"""Learning of the kinds of fruit: features of finds, two layers on top, one score, and figures on pictures apart."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.skills.perception.detection.errors import BadTraining
from pomona.skills.perception.detection.onnx_runtime import INPUT
from pomona.tools.fruit_kinds.kind_head import NONE, SIDE, KindScore, logits
from pomona.tools.photographs.box_evaluation import PRECISION
from pomona.tools.pytorch.weights import exported
from pomona.tools.training.augmentation import change_look
from pomona.tools.training.kind_finds import MOST, UNKNOWN, KindFinds, KindPicture
from pomona.tools.training.kind_network import FEATURES, KindNetwork

VIEWS = 4  # changed views of each find that is learnt from, beside the plain one
BATCH, EPOCHS, RATE, DECAY = (
    256,
    12,
    4e-3,
    0.02,
)  # of the two layers; AdamW with one cycle of the rate
SMOOTHING = 0.03  # of the labels
SHARES = {"apple": 4.0, NONE: 2.5}  # of kinds in a batch; 1 for each other
HEAVIEST = 12.0  # largest weight of one find over the mean
SAVE_S = 60.0  # between two checkpoints [s]
LEAST_SLOPE = 0.05  # of the fitted line: more of either never lowers a score
PICTURES = 32  # that go through the trunk at once


def view(picture: UInt8, rng: np.random.Generator | None = None) -> UInt8:
    """Return a window (96, 96, 3) of a find's picture: plain, or mirrored, turned, scaled, and of another look."""
    middle, half = 0.5 * (len(picture) - 1), 0.5 * (SIDE - 1)
    step, angle, shift, mirror = len(picture) / SIDE, 0.0, np.zeros(2), 1.0
    if rng is not None:
        step *= float(np.exp(rng.uniform(np.log(0.78), np.log(1.12))))
        angle, shift, mirror = (
            rng.normal(0.0, 0.2),
            rng.normal(0.0, 4.0, 2),
            float(rng.choice([-1.0, 1.0])),
        )
        if rng.random() < 0.4:  # fewer pixels, as small fruit has
            few = int(rng.integers(20, 70))
            small = cv2.resize(picture, (few, few), interpolation=cv2.INTER_AREA)
            picture = np.asarray(
                cv2.resize(small, picture.shape[1::-1], interpolation=cv2.INTER_LINEAR), np.uint8
            )
    turn = step * np.array(
        [[np.cos(angle) * mirror, -np.sin(angle)], [np.sin(angle) * mirror, np.cos(angle)]]
    )
    place = np.column_stack([turn, middle + shift - turn @ (half, half)])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    window = cv2.warpAffine(
        picture, place, (SIDE, SIDE), flags=flags, borderMode=cv2.BORDER_REPLICATE
    )
    return (
        np.asarray(window, np.uint8)
        if rng is None
        else change_look(np.asarray(window, np.uint8), rng)
    )


@dataclass(frozen=True, slots=True, eq=False)
class KindFeatures:
    """Features of finds: of plain views, and of changed ones of those that are learnt from."""

    plain: Float32  # (n, features)
    chosen: NDArray[np.int64]  # indices of the finds that are learnt from, (m,)
    changed: Float32  # (VIEWS, m, features)


def features(
    network: KindNetwork,
    finds: KindFinds,
    pictures: Sequence[KindPicture],
    work: Path,
    device: str,
    progress: Callable[[int, int], None] | None = None,
) -> KindFeatures:
    """Return features of all finds, kept in `work` at least each minute: a later call goes on."""
    rng = np.random.default_rng(0)
    train = np.array([picture.split == "train" for picture in pictures])[finds.owners]
    usable = np.nonzero(train & (finds.kinds != UNKNOWN))[0]
    parts = [
        rng.permutation(usable[finds.owners[usable] == owner])[:MOST]
        for owner in np.unique(finds.owners[usable])
    ]
    chosen = np.sort(np.concatenate([np.empty(0, np.int64), *parts]))
    jobs = [np.arange(len(finds.scores)), *([chosen] * VIEWS)]
    done: list[Float32] = []
    total, count, saved = sum(len(job) for job in jobs), 0, time.monotonic()
    kept = work / "features.npz"
    if kept.is_file():
        with np.load(kept) as stored:
            done = [np.asarray(stored[str(k)], np.float32) for k in range(len(stored.files))]
    for number, job in enumerate(jobs):
        have = len(done[number]) if number < len(done) else 0
        if number == len(done):
            done.append(np.empty((0, FEATURES), np.float32))
        count += have
        for first in range(have, len(job), PICTURES):
            some = job[first : first + PICTURES]
            changes = [
                None if number == 0 else np.random.default_rng((number, k)) for k in some.tolist()
            ]
            views = np.stack(
                [view(finds.pictures[k], change) for k, change in zip(some, changes, strict=True)]
            )
            done[number] = np.concatenate([done[number], _read(network, views, device)])
            count += len(some)
            if progress is not None:
                progress(count, total)
            if time.monotonic() - saved > SAVE_S or count == total:
                _save(kept, done)
                saved = time.monotonic()
    return KindFeatures(done[0], chosen, np.stack(done[1:]))


@torch.no_grad()
def _read(network: KindNetwork, views: UInt8, device: str) -> Float32:
    planes = torch.from_numpy(np.ascontiguousarray(views.transpose(0, 3, 1, 2))).to(device)
    return np.asarray(network.features(planes.float() / 255.0 - 0.5).cpu().numpy(), np.float32)


def _save(path: Path, parts: Sequence[Float32]) -> None:
    part = path.with_suffix(".part")
    with part.open("wb") as stream:
        np.savez(stream, **{str(k): values.astype(np.float16) for k, values in enumerate(parts)})  # type: ignore[arg-type]
    part.replace(path)


def learn(
    network: KindNetwork,
    learnt: KindFeatures,
    finds: KindFinds,
    pictures: Sequence[KindPicture],
    names: Sequence[str],
) -> None:
    """Teach the two layers; the network is in evaluation mode afterwards. Raises BadTraining: a kind has no finds."""
    torch.manual_seed(0)
    network.hidden.reset_parameters()
    network.last.reset_parameters()
    kinds = finds.kinds[learnt.chosen]
    missing = [name for k, name in enumerate(names) if not (kinds == k).any()]
    if missing:
        raise BadTraining(f"no find of {', '.join(missing)} is there to learn from")
    sources = np.array([picture.source for picture in pictures])[finds.owners[learnt.chosen]]
    rows = np.concatenate([learnt.plain[learnt.chosen], *learnt.changed])
    weights = np.tile(_balanced(finds.weights[learnt.chosen], kinds, sources, names), 1 + VIEWS)
    inputs, wanted = torch.from_numpy(rows), torch.from_numpy(np.tile(kinds, 1 + VIEWS))
    counts = torch.from_numpy(weights.astype(np.float32))
    network.measure(inputs)
    steps = max(1, EPOCHS * len(rows) // BATCH)
    layers = [*network.hidden.parameters(), *network.last.parameters()]
    for layer in layers:
        layer.requires_grad_(True)
    optimiser = torch.optim.AdamW(layers, RATE, weight_decay=DECAY)
    rate = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, total_steps=steps)
    network.train()
    for _ in range(steps):
        some = torch.randint(0, len(rows), (BATCH,))
        losses = functional.cross_entropy(
            network.judge(inputs[some]), wanted[some], reduction="none", label_smoothing=SMOOTHING
        )
        optimiser.zero_grad()
        (losses * counts[some]).mean().backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        rate.step()
    network.eval()


def _balanced(
    weights: Float64, kinds: NDArray[np.int64], sources: NDArray[np.str_], names: Sequence[str]
) -> Float64:
    """Return weights of mean 1: each kind has its share, and in a kind each source counts alike."""
    balanced = np.zeros(len(weights))
    for kind, name in enumerate(names):
        there = np.unique(sources[kinds == kind])
        for source in there:
            mine = (kinds == kind) & (sources == source)
            balanced[mine] = (
                weights[mine]
                * SHARES.get(name, 1.0)
                / len(there)
                / max(float(weights[mine].sum()), 1e-9)
            )
    return np.asarray(np.minimum(balanced * (len(balanced) / balanced.sum()), HEAVIEST), np.float64)


@torch.no_grad()
def probabilities(network: KindNetwork, rows: Float32) -> Float64:
    """Return the probability of each kind, (n, kinds), of features (n, features)."""
    judged: Tensor = torch.softmax(network.judge(torch.from_numpy(rows)), dim=1)
    return np.asarray(judged.numpy(), np.float64)


def fit_kind_score(
    scores: Float64, likely: Float64, right: NDArray[np.bool_], weights: Float64
) -> KindScore:
    """Return the line that makes one score of the finder's score and a kind's probability, (n,) each.

    Args:
        right: which finds are of the kind, (n,).
        weights: of the finds, (n,).
    """
    rows = np.column_stack([logits(scores), logits(likely), np.ones(len(scores))])
    line = np.array([1.0, 1.0, 0.0])
    for _ in range(
        50
    ):  # Newton's steps of a logistic regression, with a weak prior about the start
        chance = 1.0 / (1.0 + np.exp(-rows @ line))
        curvature = (rows * (weights * chance * (1.0 - chance))[:, None]).T @ rows + 1e-3 * np.eye(
            3
        )
        line = line + np.linalg.solve(
            curvature, rows.T @ (weights * (right - chance)) - 1e-3 * (line - (1.0, 1.0, 0.0))
        )
    return KindScore(
        max(float(line[0]), LEAST_SLOPE), max(float(line[1]), LEAST_SLOPE), float(line[2])
    )


def fitted(
    network: KindNetwork,
    learnt: KindFeatures,
    finds: KindFinds,
    pictures: Sequence[KindPicture],
    kinds: Sequence[str],
) -> KindScore:
    """Return the score by finds of the split val: from 0.5 on, 0.90 of them are of the first kind.

    Finds without a label in labelled photographs are left out: most of them are fruit that people did not label.
    """
    mine = np.array([picture.split == "val" for picture in pictures])[finds.owners]
    known = np.nonzero(mine & (finds.kinds != UNKNOWN))[0]
    likely = probabilities(network, learnt.plain[known])[:, 0]
    sources = np.array([picture.source for picture in pictures])[finds.owners[known]]
    right, names = finds.kinds[known] == 0, [kinds[0], "another"]
    weights = _balanced(finds.weights[known], np.where(right, 0, 1), sources, names)
    line = fit_kind_score(finds.scores[known], likely, right, weights)
    scores = line.of(finds.scores[known], likely)
    order = np.argsort(-scores, kind="stable")
    good = np.nonzero(np.cumsum(right[order]) >= PRECISION * np.arange(1, len(order) + 1))[0]
    least = float(logits(scores[order[good[-1:]]])[0]) if len(good) else 0.0
    return replace(line, offset=line.offset - least)


def exported_kinds(path: Path, network: KindNetwork) -> bytes:
    """Return the network as ONNX. Raises BadWeights: a parameter is not finite; MissingPackage: without onnx."""
    return exported(
        path, network, (2, 3, SIDE, SIDE), ["kinds"], {INPUT: {0: "n"}, "kinds": {0: "n"}}
    )


def table(
    network: KindNetwork,
    learnt: KindFeatures,
    finds: KindFinds,
    pictures: Sequence[KindPicture],
    names: Sequence[str],
    score: KindScore,
) -> str:
    """Return figures of the split test as Markdown: finds from 0.5 on of each source, before and for each kind."""
    likely = probabilities(network, learnt.plain)
    scores = [
        finds.scores,
        *(score.of(finds.scores, likely[:, kind]) for kind in range(len(names) - 1)),
    ]
    tested = np.array([picture.split == "test" for picture in pictures])
    sources = np.array([picture.source for picture in pictures])
    lines = [
        f"| source | pictures | finds before | {' | '.join(names[:-1])} |",
        "|---" * (len(names) + 2) + "|",
    ]
    for source in np.unique(sources[tested]).tolist():
        mine = (tested & (sources == source))[finds.owners]
        counts = " | ".join(str(int((mine & (values >= 0.5)).sum())) for values in scores)
        lines.append(f"| {source} | {int((tested & (sources == source)).sum())} | {counts} |")
    return "\n".join([*lines, ""])
