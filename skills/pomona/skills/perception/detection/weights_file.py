"""Weights files of the compact detector: both networks as ONNX in one archive, read without PyTorch.

A weights file is a zip archive of three members:

- `finder.onnx` and `close_look.onnx`: input `picture`, float32 (n, 3, h, w), RGB in 0..1 minus 0.5. The finder's h and
  w are multiples of 32, the close look's 96. Outputs are those of `FinderNetwork` and `CloseLookNetwork`.
- `about.json`: the file's format, how the weights were made, and their score.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from pomona.executive.values.archives import ArchiveTooLarge, open_archive
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.fused_score import FusedScore, read_fused_score
from pomona.skills.perception.detection.scores import PowerScore, ScoreMap

FORMAT = "pomona compact detector 3"

FINDER, CLOSE_LOOK, ABOUT = "finder.onnx", "close_look.onnx", "about.json"

ENDING = ".weights"

MOST_BYTES = 64 << 20  # of all members, unpacked; the largest shipped file has 11 MB [byte]
MOST_TORCH_BYTES = 256 << 20  # of a file of PyTorch; a checkpoint of DOPE's network has 201 MB [byte]

Score = FusedScore | PowerScore  # from the answers of both networks to the ratio of such detections that are fruit
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
    return StoredDetector(members[FINDER], members[CLOSE_LOOK], told, scores, about.get("widths", {}))


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
        raise BadWeights(path, f"maps its scores by the line {slope} x + {offset}, which does not rise")
    return ScoreMap(slope, offset)


def is_torch_file(path: Path | str) -> bool:
    """Return True for a file that PyTorch saved, as earlier versions of Pomona and DOPE do."""
    try:
        with open_archive(path, MOST_TORCH_BYTES) as archive:
            return any(name.endswith("data.pkl") for name in archive.namelist())
    except Exception:  # zipfile's errors have no common root
        return False


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
