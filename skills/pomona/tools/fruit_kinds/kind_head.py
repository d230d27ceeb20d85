"""A small network that judges the kind of each find, and one score of a find for the kind that is looked for.

The finder finds round fruit; on a shelf of tomatoes it is as sure as on one of apples. The head reads a picture of each
find with some of its surroundings, and gives a probability for each kind.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from pomona.executive.values.archives import open_archive
from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import Network
from pomona.skills.perception.detection.compact_detector import Judge
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.instances import FoundFruit
from pomona.skills.perception.detection.onnx_runtime import judge_network, onnx_network

SIDE = 96  # of the square picture of a find [px]
CONTEXT = 1.5  # side of that picture over the longer side of the find's box
BATCH = 32  # pictures that go through the network at once
NONE = "none"  # the last kind: none of the others

FORMAT = "pomona kinds of fruit 1"
NETWORK = "kinds.onnx"
ABOUT = "about.json"
ENDING = ".kinds"
CALIBRATION = "score"  # note about a file: the meaning of a score of 0.5
MOST_BYTES = 32 << 20  # of both members, unpacked [byte]
EDGE = 1e-4  # scores and probabilities are kept so far from 0 and 1 before their logits are taken


@dataclass(frozen=True, slots=True)
class KindScore:
    """Line from the logits of the finder's score and of the kind's probability to the logit of one score."""

    found: float = 1.0  # weight of the finder's score
    kind: float = 1.0  # weight of the kind's probability
    offset: float = 0.0

    def of(self, scores: Float64, probabilities: Float64) -> Float64:
        """Return scores (n,), 0 to 1, from the finder's scores (n,) and the probabilities of the kind (n,)."""
        logit = self.found * logits(scores) + self.kind * logits(probabilities) + self.offset
        return np.asarray(1.0 / (1.0 + np.exp(-logit)), np.float64)


def logits(values: Float64) -> Float64:
    """Return logits of values in 0..1, in their shape."""
    inner = np.clip(values, EDGE, 1.0 - EDGE)
    return np.asarray(np.log(inner) - np.log1p(-inner), np.float64)


@dataclass(frozen=True, slots=True)
class StoredKinds:
    """Content of a file of kinds."""

    network: bytes  # as ONNX: pictures (n, 3, 96, 96), RGB in 0..1 minus 0.5, to logits (n, kinds)
    kinds: tuple[str, ...]  # names of the logits; the last is `NONE`
    score: KindScore = KindScore()
    about: Mapping[str, str] = field(default_factory=dict)  # how the weights were made


def read_kinds(path: Path) -> StoredKinds:
    """Read a file of kinds. Raises BadWeights: unreadable, or another format."""
    try:
        with open_archive(path, MOST_BYTES) as archive:
            about = json.loads(archive.read(ABOUT))
            network = archive.read(NETWORK)
        if about["format"] != FORMAT:
            raise BadWeights(
                path, f"has the format {str(about['format'])[:60]!r}, expected {FORMAT!r}"
            )
        kinds = tuple(str(kind) for kind in about["kinds"])
        values = {name: float(about["score"][name]) for name in ("found", "kind", "offset")}
        notes = {str(key): str(value) for key, value in about.get("about", {}).items()}
    except BadWeights:
        raise
    except Exception as error:  # zipfile's and json's errors have no common root
        raise BadWeights(
            path, f"cannot be read as kinds of fruit: {type(error).__name__}"
        ) from error
    if len(set(kinds)) != len(kinds) or len(kinds) < 2 or kinds[-1] != NONE:
        raise BadWeights(
            path, f"has the kinds {', '.join(kinds)[:60]}: expected names, the last of them {NONE}"
        )
    if not (
        np.isfinite(list(values.values())).all() and min(values["found"], values["kind"]) > 0.0
    ):
        raise BadWeights(path, f"has a score that does not rise: {values}")
    return StoredKinds(network, kinds, KindScore(**values), notes)


def find_picture(colour: UInt8, box: Float64, side: int = SIDE) -> UInt8:
    """Return a square picture (side, side, 3) of a box x, y, w, h (4,) [px] with its surroundings."""
    half = 0.5 * CONTEXT * float(box[2:].max())
    low = box[:2] + 0.5 * box[2:] - half
    step = 2.0 * half / side
    source = colour
    if step > 1.0:  # large fruit is shrunk with the means of its pixels
        first = np.maximum(np.floor(low).astype(int), 0)
        last = np.ceil(low + 2.0 * half).astype(int)
        source = colour[
            first[1] : max(last[1], first[1] + 1), first[0] : max(last[0], first[0] + 1)
        ]
        low = low - first
        width, height = (max(1, round(n / step)) for n in source.shape[1::-1])
        low = low * (width / source.shape[1], height / source.shape[0])
        source = np.asarray(
            cv2.resize(source, (width, height), interpolation=cv2.INTER_AREA), np.uint8
        )
        step = 1.0
    shift = low + 0.5 * step - 0.5
    place = np.array([[step, 0.0, shift[0]], [0.0, step, shift[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(source, place, (side, side), flags=flags, borderMode=cv2.BORDER_REPLICATE),
        np.uint8,
    )


class KindHead:
    """The network and its score, ready to run on the CPU, in the caller's thread.

    Args:
        network: as `onnx_network` gives it.
        kinds: names of its logits.
        score: of a find, for the kind that is looked for.
        path: of the file, for errors.
    """

    def __init__(
        self, network: Network, kinds: tuple[str, ...], score: KindScore, path: Path = Path()
    ) -> None:
        self.kinds = kinds
        self.score = score
        self.path = path
        self._network = network

    @classmethod
    def load(cls, path: Path) -> KindHead:
        """Load a file of kinds. Raises BadWeights: unreadable, or another format."""
        stored = read_kinds(path)
        judge_network(stored.network, path, NETWORK)
        head = cls(onnx_network(stored.network, path, NETWORK), stored.kinds, stored.score, path)
        head.probabilities(np.zeros((SIDE, SIDE, 3), np.uint8), np.array([[0.0, 0.0, 9.0, 9.0]]))
        return head

    def judged(self, colour: UInt8, found: list[FoundFruit], kind: str) -> list[FoundFruit]:
        """Return the finds in a picture (h, w, 3) uint8 RGB with their scores for one kind; unchanged for another.

        Raises BadWeights: the network gives values that are not finite.
        """
        if kind not in self.kinds[:-1] or not found:
            return found
        height, width = colour.shape[:2]
        likely = self.probabilities(
            colour, np.array([fruit.outline(width, height) for fruit in found])
        )
        scores = self.score.of(
            np.array([fruit.score for fruit in found]), likely[:, self.kinds.index(kind)]
        )
        return [
            replace(fruit, score=float(score)) for fruit, score in zip(found, scores, strict=True)
        ]

    def probabilities(self, colour: UInt8, boxes: Float64) -> Float64:
        """Return the probability of each kind of each box (n, 4) in a picture (h, w, 3) uint8 RGB, (n, kinds).

        Raises BadWeights: the network gives another number of values, or values that are not finite.
        """
        found = [np.empty((0, len(self.kinds)), np.float32)]
        for first in range(0, len(boxes), BATCH):
            pictures = np.stack([find_picture(colour, box) for box in boxes[first : first + BATCH]])
            planes = np.ascontiguousarray(pictures.transpose(0, 3, 1, 2)) * np.float32(
                1.0 / 255.0
            ) - np.float32(0.5)
            found.append(self._network(planes)[0])
            if (
                found[-1].shape != (len(pictures), len(self.kinds))
                or not np.isfinite(found[-1]).all()
            ):
                raise BadWeights(
                    self.path, f"{NETWORK} in it does not give {len(self.kinds)} finite logits"
                )
        values = np.concatenate(found).astype(np.float64)
        raised = np.exp(values - values.max(axis=1, keepdims=True))
        return np.asarray(raised / raised.sum(axis=1, keepdims=True), np.float64)


def kinds_beside(weights: Path) -> StoredKinds | None:
    """Return the kinds that a file beside these weights knows; None without a file. Raises BadWeights."""
    path = weights.with_suffix(ENDING)
    return read_kinds(path) if path.is_file() else None


def load_judge(path: Path) -> Judge:
    """Return the judgement of finds by a file of kinds. Raises BadWeights: as of `KindHead.load`."""
    return KindHead.load(path).judged
