"""The compact detector end to end: find fruit in the whole picture, look closely at each, solve for poses."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.skills.perception.detection.close_look import REFERENCE_LENGTH, look_at
from pomona.skills.perception.detection.errors import MissingPackage
from pomona.skills.perception.detection.found_fruit import FoundFruit, inside
from pomona.skills.perception.detection.frame_check import check_picture
from pomona.skills.perception.detection.onnx_runtime import onnx_network
from pomona.skills.perception.detection.options import DetectorOptions
from pomona.skills.perception.detection.outputs import (
    ALL_OUTPUTS,
    AXIS,
    BOX,
    CENTRE,
    CLOSE_LOOK_SIZE,
    KIND,
    SEEN,
    SPREAD,
    Network,
)
from pomona.skills.perception.detection.peaks import Peak, decode_offsets
from pomona.skills.perception.detection.scores import ScoreMap
from pomona.skills.perception.detection.weights_file import (
    CLOSE_LOOK,
    FINDER,
    StoredDetector,
    is_torch_file,
    read_weights,
)

MIRROR = np.ones(ALL_OUTPUTS)
MIRROR[[CENTRE.start, AXIS.start, BOX.start]] = -1.0
"""What the close look says of a mirrored picture, times this, is true of the picture."""

HOPELESS = 0.2
"""A fruit with less score after a look is not looked at again: a quarter of the places, and hardly any fruit."""

MULTIPLE = 16
"""The finder's input sides are multiples of this [px]."""

BATCH = 16
"""Looks that go through the network at once: more no longer fit into the processor's cache, and each takes longer."""


class CompactDetector:
    """Both networks, ready to run on the CPU, in the caller's thread.

    Args:
        finder, close_look: networks, as `onnx_network` gives them.
        options: of the search.
        scores: from the networks' scores to the ratio of such detections that are fruit.
    """

    def __init__(
        self,
        finder: Network,
        close_look: Network,
        options: DetectorOptions | None = None,
        scores: ScoreMap | None = None,
    ) -> None:
        self.options, self.scores = options or DetectorOptions(), scores or ScoreMap()
        self._finder, self._close_look = finder, close_look

    @classmethod
    def load(cls, path: Path | str, options: DetectorOptions | None = None) -> CompactDetector:
        """Load from a weights file, with ONNX Runtime as the engine.

        Raises:
            BadWeights: unreadable or not fitting.
            MissingPackage: PyTorch wrote the file, and the extra `torch` is not installed.
        """
        stored = read_stored(path)
        finder = onnx_network(stored.finder, path, FINDER)
        close_look = onnx_network(stored.close_look, path, CLOSE_LOOK)
        return cls(finder, close_look, options, stored.scores)

    def looking(self, options: DetectorOptions) -> CompactDetector:
        """The same networks with other options."""
        other = copy.copy(self)
        other.options = options
        return other

    def warm_up(self, width: int = 640, height: int = 480) -> None:
        """Search an empty picture and take one look, so that the first picture is not slower than the rest."""
        blank = np.zeros((height, width, 3), np.uint8)
        self.belief_maps(blank)
        K = np.array([[width, 0.0, 0.5 * width], [0.0, width, 0.5 * height], [0.0, 0.0, 1.0]])
        self._look(blank, K, [(K[:2, 2], 40.0)], [0.0], self.options.mirrored)

    def find(self, colour: UInt8, K: Float64) -> list[FoundFruit]:
        """All fruit in a picture, by falling score.

        Args:
            colour: (h, w, 3) uint8 RGB.
            K: camera matrix (3, 3) [px].

        Raises:
            BadFrame: another shape or type.
        """
        options = self.options
        places = self.places(colour, options.finder_threshold)[: options.most_fruit]
        if not places:
            return []
        spots = [(place.keypoints[8], place.size) for place in places]
        beliefs = [min(1.0, place.belief) for place in places]
        seen = self._look(colour, K, spots, beliefs, options.mirrored and options.looks == 1)
        for number in range(2, options.looks + 1):
            again = [k for k, fruit in enumerate(seen) if fruit.score >= HOPELESS]
            if not again:
                break
            spots = [(seen[k].centre, seen[k].size) for k in again]
            better = self._look(
                colour, K, spots, [beliefs[k] for k in again], options.mirrored and number == options.looks
            )
            for k, fruit in zip(again, better, strict=True):
                seen[k] = replace(fruit, score=float(np.sqrt(seen[k].score * fruit.score)))
        for k, place in enumerate(places):
            if seen[k].box is None and place.box is not None:  # a close look that knows no boxes
                seen[k] = replace(seen[k], box=inside(place.box, colour.shape[1], colour.shape[0]))
        kept: list[FoundFruit] = []
        for fruit in sorted(seen, key=lambda fruit: -fruit.score):
            if all(
                np.linalg.norm(fruit.centre - other.centre) > options.apart * max(fruit.size, other.size)
                for other in kept
            ):
                kept.append(replace(fruit, score=self.scores(fruit.score)))
        return kept

    def places(self, colour: UInt8, threshold: float) -> list[Peak]:
        """Where the finder sees fruit, strongest first, in pixels of the picture.

        Raises:
            BadFrame: another shape or type.
        """
        (belief, offsets, *reaches), factor = self._maps(colour)
        return [
            Peak(
                (place.keypoints + 0.5) / factor - 0.5,
                place.size / factor,
                place.belief,
                None if place.box is None else place.box / factor,
            )
            for place in decode_offsets(belief, offsets, threshold, reaches=reaches[0] if reaches else None)
        ]

    def belief_maps(self, colour: UInt8) -> tuple[Float32, Float32, float]:
        """The finder's belief (9, h, w) and offsets (17, h, w), and the factor by which the picture was shrunk.

        Raises:
            BadFrame: another shape or type.
        """
        (belief, offsets, *_), factor = self._maps(colour)
        return belief, offsets, factor

    def _maps(self, colour: UInt8) -> tuple[list[Float32], float]:
        check_picture(colour)
        height, width = colour.shape[:2]
        factor = self.options.working_width / width
        small = (self.options.working_width, max(1, round(height * factor)))
        flag = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
        shrunk = np.asarray(cv2.resize(np.ascontiguousarray(colour), small, interpolation=flag), np.uint8)
        below, right = -small[1] % MULTIPLE, -small[0] % MULTIPLE
        if below or right:
            shrunk = cv2.copyMakeBorder(shrunk, 0, below, 0, right, cv2.BORDER_CONSTANT, value=(114, 114, 114))
        return [part[0] for part in self._finder(_input(shrunk[None]))], factor

    def _look(
        self, colour: UInt8, K: Float64, places: list[tuple[Float64, float]], beliefs: list[float], mirrored: bool
    ) -> list[FoundFruit]:
        side = (CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
        looks = [look_at(K, centre, size) for centre, size in places]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        pictures = np.stack([cv2.warpPerspective(colour, look.picture_from_look, side, flags=flags) for look in looks])
        if mirrored:
            pictures = np.concatenate([pictures, pictures[:, :, ::-1]])
        parts = np.array_split(pictures, -(-len(pictures) // BATCH))
        output = np.concatenate([self._close_look(_input(part))[0] for part in parts]).astype(np.float64)
        if mirrored:
            output = 0.5 * (output[: len(looks)] + output[len(looks) :] * MIRROR[: output.shape[1]])
        found, (height, width) = [], colour.shape[:2]
        for row, look, belief in zip(output, looks, beliefs, strict=True):
            p_camera, stem = look.place(row[: SPREAD.start])
            # A fruit beside the look cannot be placed behind the camera, however wide the look.
            p_camera[2] = max(p_camera[2], 1e-3)
            size = K[0, 0] * REFERENCE_LENGTH / p_camera[2]
            centre = p_camera[:2] / p_camera[2] * (K[0, 0], K[1, 1]) + K[:2, 2]
            half = 0.5 * CLOSE_LOOK_SIZE * K[0, 0] / look.focal
            spreads = np.exp(np.clip(row[SPREAD], -6.0, 2.0)) * (half, 1.0, 1.0)
            fruit, seen = 1.0 / (1.0 + np.exp(-row[[KIND, SEEN]]))
            box = inside(look.place_box(row[BOX]), width, height) if len(row) == ALL_OUTPUTS else None
            score = float(np.sqrt(belief * fruit))
            found.append(FoundFruit(p_camera, stem, centre, size, spreads, score, float(seen), box))
        return found


def read_stored(path: Path | str) -> StoredDetector:
    """Read a weights file; one that an earlier version wrote with PyTorch is converted.

    Raises:
        BadWeights: unreadable or not fitting.
        MissingPackage: PyTorch wrote it, and the extra `torch` is not installed.
    """
    if not is_torch_file(path):
        return read_weights(path)
    try:
        from pomona.skills.perception.detection.weights import convert
    except ImportError as error:
        purpose = f"reads {path}, which an earlier version wrote,"
        raise MissingPackage("torch", purpose) from error
    return convert(path)


def _input(pictures: UInt8) -> Float32:
    """uint8 pictures (n, h, w, 3) as a network's input (n, 3, h, w)."""
    planes = np.ascontiguousarray(pictures.transpose(0, 3, 1, 2))
    return planes * np.float32(1.0 / 255.0) - np.float32(0.5)
