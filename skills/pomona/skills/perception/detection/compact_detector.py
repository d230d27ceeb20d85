"""The compact detector end to end: find fruit in the whole picture, look closely at each, solve for poses."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import REFERENCE_LENGTH, look_at
from pomona.skills.perception.detection.compact_network import CloseLookNetwork, FinderNetwork, to_input
from pomona.skills.perception.detection.found_fruit import FoundFruit, inside
from pomona.skills.perception.detection.frame_check import check_picture
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
)
from pomona.skills.perception.detection.peaks import Peak, decode_offsets
from pomona.skills.perception.detection.processor import has_bfloat16
from pomona.skills.perception.detection.scores import ScoreMap
from pomona.skills.perception.detection.weights import load_compact, load_scores

MIRROR = np.ones(ALL_OUTPUTS)
MIRROR[[CENTRE.start, AXIS.start, BOX.start]] = -1.0
"""What the close look says of a mirrored picture, times this, is true of the picture."""

HOPELESS = 0.2
"""A fruit with less score after a look is not looked at again: a quarter of the places, and hardly any fruit."""

MULTIPLE = 16
"""The finder's input sides are multiples of this [px]."""

FINDER_EXAMPLE = (1, 3, 12 * MULTIPLE, 16 * MULTIPLE)
CLOSE_LOOK_EXAMPLE = (2, 3, CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
"""Shapes of inputs with which the networks' graphs are drawn up; a graph holds none of their sizes but the looks'."""

Run = Callable[[Tensor], Any]
"""Carries out a network: float32 pictures (n, 3, h, w) to what the network gives."""

BATCH = 16
"""Looks that go through the network at once: more no longer fit into the processor's cache, and each takes longer."""


class CompactDetector:
    """Both networks, ready to run on the CPU. Calls release the interpreter's lock while the networks run."""

    def __init__(
        self,
        finder: FinderNetwork,
        close_look: CloseLookNetwork,
        options: DetectorOptions | None = None,
        scores: ScoreMap | None = None,
    ) -> None:
        self.options, self.scores = options or DetectorOptions(), scores or ScoreMap()
        number = torch.bfloat16 if has_bfloat16() else torch.float32
        # Any size will do: the graph that is traced holds no sizes.
        self._finder = _ready(finder, torch.zeros(FINDER_EXAMPLE), number)
        self._close_look = _ready(close_look, torch.zeros(CLOSE_LOOK_EXAMPLE), number)

    @classmethod
    def load(cls, path: Path | str, options: DetectorOptions | None = None) -> CompactDetector:
        """Load from a weights file.

        Raises:
            BadWeights: unreadable or not fitting.
        """
        with _one_thread():
            finder, close_look, _ = load_compact(path)
            return cls(finder, close_look, options, load_scores(path))

    @classmethod
    def running(
        cls, finder: Run, close_look: Run, options: DetectorOptions | None = None, scores: ScoreMap | None = None
    ) -> CompactDetector:
        """A detector whose networks something else runs, such as ONNX Runtime."""
        detector = cls.__new__(cls)
        detector.options, detector.scores = options or DetectorOptions(), scores or ScoreMap()
        detector._finder, detector._close_look = finder, close_look
        return detector

    def looking(self, options: DetectorOptions) -> CompactDetector:
        """The same networks with other options."""
        other = copy.copy(self)
        other.options = options
        return other

    def warm_up(self, width: int = 640, height: int = 480) -> None:
        """Run once for every size of batch, in one thread as `find` does, so that the first picture is not slower than
        the rest."""
        with _one_thread():
            self._warm_up(width, height)

    def _warm_up(self, width: int, height: int) -> None:
        blank = np.zeros((height, width, 3), np.uint8)
        self.belief_maps(blank)
        K = np.array([[width, 0.0, 0.5 * width], [0.0, width, 0.5 * height], [0.0, 0.0, 1.0]])
        for count in range(1, 9):
            for mirrored in {False, self.options.mirrored}:
                self._look(blank, K, [(K[:2, 2], 40.0)] * count, [0.0] * count, mirrored)

    def find(self, colour: UInt8, K: Float64) -> list[FoundFruit]:
        """All fruit in a picture, by falling score.

        Args:
            colour: (h, w, 3) uint8 RGB.
            K: camera matrix (3, 3) [px].

        Raises:
            BadFrame: another shape or type.
        """
        with _one_thread():
            return self._find(colour, K)

    def _find(self, colour: UInt8, K: Float64) -> list[FoundFruit]:
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

    def belief_maps(self, colour: UInt8) -> tuple[NDArray[np.float32], NDArray[np.float32], float]:
        """The finder's belief (9, h, w) and offsets (17, h, w), and the factor by which the picture was shrunk.

        Raises:
            BadFrame: another shape or type.
        """
        (belief, offsets, *_), factor = self._maps(colour)
        return belief, offsets, factor

    def _maps(self, colour: UInt8) -> tuple[list[NDArray[np.float32]], float]:
        check_picture(colour)
        height, width = colour.shape[:2]
        factor = self.options.working_width / width
        small = (self.options.working_width, max(1, round(height * factor)))
        flag = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
        shrunk = np.asarray(cv2.resize(np.ascontiguousarray(colour), small, interpolation=flag), np.uint8)
        below, right = -small[1] % MULTIPLE, -small[0] % MULTIPLE
        if below or right:
            shrunk = cv2.copyMakeBorder(shrunk, 0, below, 0, right, cv2.BORDER_CONSTANT, value=(114, 114, 114))
        with torch.inference_mode():
            maps = self._finder(to_input(torch.from_numpy(shrunk[None])))
        return [part[0].float().numpy() for part in maps], factor

    def _look(
        self, colour: UInt8, K: Float64, places: list[tuple[Float64, float]], beliefs: list[float], mirrored: bool
    ) -> list[FoundFruit]:
        side = (CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
        looks = [look_at(K, centre, size) for centre, size in places]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        pictures = np.stack([cv2.warpPerspective(colour, look.picture_from_look, side, flags=flags) for look in looks])
        if mirrored:
            pictures = np.concatenate([pictures, pictures[:, :, ::-1]])
        with torch.inference_mode():
            parts = np.array_split(pictures, -(-len(pictures) // BATCH))
            outputs = [self._close_look(to_input(torch.from_numpy(part))).float() for part in parts]
        output = torch.cat(outputs).numpy().astype(np.float64)
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


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch work in one thread: on layers this small threads wait for each other longer than they work.

    On a busy machine two threads were six times slower than one, and one never disturbs a control loop.
    """
    before = torch.get_num_threads()
    if before == 1:
        yield
        return
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _ready(network: nn.Module, example: Tensor, number: torch.dtype) -> Run:
    """The network as a frozen graph with folded normalisation and prepacked weights."""
    twin = copy.deepcopy(network).eval().to(memory_format=torch.channels_last).to(number)  # type: ignore[call-overload]
    sample = example.to(number).to(memory_format=torch.channels_last)
    with torch.inference_mode(), warnings.catch_warnings():
        # TorchScript is announced to go; on a CPU nothing else folds and prepacks without compiling at run time.
        warnings.simplefilter("ignore", DeprecationWarning)
        traced: Any = torch.jit.trace(twin, sample, check_trace=False)  # type: ignore[no-untyped-call]
        frozen: Run = torch.jit.optimize_for_inference(traced)
    return lambda pictures: frozen(pictures.to(number))
