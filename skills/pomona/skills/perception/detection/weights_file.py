"""Weights files of the compact detector: both networks as ONNX in one archive, read without PyTorch, and their score.

A weights file is a zip archive of three members:

- `finder.onnx` and `close_look.onnx`: input `picture`, float32 (n, 3, h, w), RGB in 0..1 minus 0.5. The finder's h and
  w are multiples of 32, the close look's 96. Outputs are those of `FinderNetwork` and `CloseLookNetwork`.
- `about.json`: the file's format, how the weights were made, and their score.

The score is fitted to heat, box quality and the close look's kind. Products of powers of these cost one domain several
points of recall: heat separates better on photographs, kind on rendered frames. A net of a few units serves both with
one threshold (docs/decisions.md#photographs-have-a-weights-file-of-their-own).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from pomona.executive.values.archives import ArchiveTooLarge, open_archive
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.errors import BadWeights

HOPELESS = 0.2  # least product after one look for a second one: a quarter of the places have less, and hardly any fruit
EDGE = 1e-6  # scores are kept so far from 0 and 1 before their logits are taken


@dataclass(frozen=True, slots=True)
class ScoreMap:
    """Line through logits, from a product of the networks' outputs to a ratio of fruit (Platt's scaling).

    It rises, so that it changes no order. The default changes nothing.
    """

    slope: float = 1.0  # of the line, more than 0
    offset: float = 0.0  # of the line

    def __call__(self, score: float) -> float:
        """Return the ratio of fruit among detections with this score, 0..1."""
        return float(self.of(np.array([score]))[0])

    def of(self, scores: Float64) -> Float64:
        """Return the same of many, (n,)."""
        if self == ScoreMap():
            return scores
        return np.asarray(
            1.0 / (1.0 + np.exp(-(self.slope * _logit(scores) + self.offset))), np.float64
        )


@dataclass(frozen=True, slots=True)
class PowerScore:
    """Score of weights without a fitted one: product of powers of heat and of the kind that both looks give."""

    line: ScoreMap = ScoreMap()  # from this product to the ratio of fruit

    @property
    def hopeless(self) -> float:
        """A place with less score after one look gets no second one."""
        return self.line(HOPELESS)

    def of(self, features: Float64) -> Float64:
        """Return scores of places with these features, logits as of `FusedScore` (n, 4): (n,)."""
        heat, _, first, second = -np.logaddexp(0.0, -features.T)
        return self.line.of(np.exp(0.5 * heat + 0.25 * (first + second)))

    def content(self) -> dict[str, float]:
        """As a weights file holds it."""
        return {"slope": self.line.slope, "offset": self.line.offset}


def _logit(scores: Float64) -> Float64:
    inner = np.clip(scores, EDGE, 1.0 - EDGE)
    return np.asarray(np.log(inner) - np.log1p(-inner), np.float64)


FEATURES = 4  # logits: heat, box quality, kind of the first look, and kind of the second look
LARGEST = 12.0  # logits are cut at ± this before the net reads them


@dataclass(frozen=True, slots=True, eq=False)
class FusedScore:
    """A net with one hidden layer of tanh units."""

    hidden: Float64  # weights and, last, bias of each unit, (units, 5)
    output: Float64  # weights of the units and, last, bias, (units + 1,)

    hopeless: float = 0.05  # a place with less score after one look gets no second one

    def __post_init__(self) -> None:
        fits = self.hidden.ndim == 2 and self.hidden.shape[1] == FEATURES + 1
        if not fits or self.output.shape != (len(self.hidden) + 1,):
            raise ValueError(
                f"a net of {self.hidden.shape} and {self.output.shape}, expected (n, 5) and (n + 1,)"
            )
        if not (np.isfinite(self.hidden).all() and np.isfinite(self.output).all()):
            raise ValueError("a net with values that are not finite")

    def of(self, features: Float64) -> Float64:
        """Estimated ratio of fruit among places with these features (n, 4): (n,), 0..1."""
        x = np.clip(np.nan_to_num(features), -LARGEST, LARGEST)
        units = np.tanh(x @ self.hidden[:, :FEATURES].T + self.hidden[:, FEATURES])
        return np.asarray(
            1.0 / (1.0 + np.exp(-(units @ self.output[:-1] + self.output[-1]))), np.float64
        )

    def content(self) -> dict[str, Any]:
        """As `read_fused_score` reads it."""
        return {"hidden": self.hidden.tolist(), "output": self.output.tolist()}


def read_fused_score(content: Mapping[str, Any]) -> FusedScore:
    """Return the score that `FusedScore.content` describes.

    Raises KeyError, TypeError, ValueError: it describes none.
    """
    return FusedScore(
        np.array(content["hidden"], np.float64), np.array(content["output"], np.float64)
    )


FORMAT = "pomona compact detector 3"

FINDER = "finder.onnx"
CLOSE_LOOK = "close_look.onnx"
ABOUT = "about.json"

ENDING = ".weights"

MOST_BYTES = 64 << 20  # of all members, unpacked; the largest shipped file has 11 MB [byte]

# from the answers of both networks to the ratio of such detections that are fruit
Score = FusedScore | PowerScore
_YEAR_ZERO = (1980, 1, 1, 0, 0, 0)  # date of each member: equal weights give equal files


@dataclass(frozen=True, slots=True)
class StoredDetector:
    """Content of a weights file."""

    finder: bytes  # finder, close_look: networks as ONNX
    close_look: bytes
    about: Mapping[str, str] = field(default_factory=dict)  # how the weights were made
    # from the answers of both networks to the ratio of such detections that are fruit
    scores: Score = field(default_factory=PowerScore)
    # of the layers of each network that comes in several; only training reads them
    widths: Mapping[str, Sequence[int]] = field(default_factory=dict)

    def members(self) -> dict[str, bytes]:
        """Content of each member, by its name."""
        about = {
            "format": FORMAT,
            "about": dict(self.about),
            "scores": self.scores.content(),
            "widths": {name: list(widths) for name, widths in self.widths.items()},
        }
        text = json.dumps(about, indent=2, ensure_ascii=False) + "\n"
        return {FINDER: self.finder, CLOSE_LOOK: self.close_look, ABOUT: text.encode()}


def write_weights(path: Path, stored: StoredDetector) -> None:
    """Write a weights file atomically."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    with ZipFile(part, "w") as archive:
        for name, content in stored.members().items():
            archive.writestr(ZipInfo(name, _YEAR_ZERO), content, ZIP_DEFLATED, 9)
    part.replace(path)


def read_weights(path: Path | str) -> StoredDetector:
    """Read a weights file. Raises BadWeights: unreadable, another format, or without a score."""
    members = _members(path, (FINDER, CLOSE_LOOK, ABOUT))
    try:
        about = json.loads(members[ABOUT])
        if about["format"] != FORMAT:
            raise BadWeights(path, f"has the format {about['format']!r}, expected {FORMAT!r}")
        told = {str(key): str(value) for key, value in about.get("about", {}).items()}
        scores = _score(path, about["scores"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BadWeights(path, f"{ABOUT} in it cannot be used: {error!r}") from error
    return StoredDetector(
        members[FINDER], members[CLOSE_LOOK], told, scores, about.get("widths", {})
    )


def _score(path: Path | str, content: Mapping[str, Any]) -> Score:
    if "hidden" in content:
        return read_fused_score(content)
    return PowerScore(score_map(path, (content["slope"], content["offset"])))


def score_map(path: Path | str, said: Any) -> ScoreMap:
    """Return the map of scores with a slope and an offset that a weights file holds.

    Raises BadWeights: these are no two numbers, or the map does not rise.
    """
    try:
        slope, offset = (float(value) for value in said)
    except (TypeError, ValueError) as error:
        raise BadWeights(path, f"holds a map of scores that cannot be read: {error}") from error
    if not (math.isfinite(offset) and 0.0 < slope < math.inf):
        raise BadWeights(
            path, f"maps its scores by the line {slope} x + {offset}, which does not rise"
        )
    return ScoreMap(slope, offset)


def _members(path: Path | str, names: tuple[str, ...]) -> dict[str, bytes]:
    if not Path(path).is_file():
        raise BadWeights(path, "no such file")
    try:
        with open_archive(path, MOST_BYTES) as archive:
            return {name: archive.read(name) for name in names}
    except ArchiveTooLarge as error:
        raise BadWeights(path, f"{error}: no weights of the compact detector") from error
    except KeyError as error:
        raise BadWeights(path, f"is not a '{FORMAT}' file: {error.args[0]}") from error
    except Exception as error:  # zipfile's and zlib's errors have no common root
        raise BadWeights(path, f"cannot be read as weights: {type(error).__name__}") from error
