"""The compact detector end to end: find fruit in the whole picture, look closely at each, solve for poses."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.executive.values.installation import entry_points
from pomona.executive.values.later import Later
from pomona.executive.values.trial import trial
from pomona.skills.perception.detection.close_look import (
    AXIS,
    CENTRE,
    CLOSE_LOOK_OUTPUTS,
    CLOSE_LOOK_SIZE,
    FINDER_MULTIPLE,
    KIND,
    REFERENCE_LENGTH,
    SEEN,
    SPREAD,
    Network,
    check_picture,
    look_at,
)
from pomona.skills.perception.detection.detection import (
    DETECTORS,
    WORKING_WIDTH,
    DetectorOptions,
)
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.instances import FoundFruit
from pomona.skills.perception.detection.onnx_runtime import judge_network, onnx_network
from pomona.skills.perception.detection.places import (
    LARGEST_FRUIT,
    LARGEST_WHOLE,
    MOST_PEAKS,
    SMALLEST_FRUIT,
    Proposal,
    agreed_score,
    megapixels,
    merge,
    read_places,
    search_sides,
    tiles,
)
from pomona.skills.perception.detection.weights_file import (
    CLOSE_LOOK,
    FEATURES,
    FINDER,
    PowerScore,
    Score,
    read_weights,
)

cv2: Any = Later("cv2")

MIRROR = np.ones(CLOSE_LOOK_OUTPUTS)
MIRROR[[CENTRE.start, AXIS.start]] = -1.0
"""Factors from the close look's output for a mirrored picture to that for the picture."""

SHIPPED = Path(__file__).resolve().parent / "weights"  # as trustworthy as the code beside it
KINDS = ".kinds"  # ending of a file beside the weights, which the entry point `kinds` of `DETECTORS` loads
BATCH = 16  # looks that go through the network at once: more no longer fit into the cache

Judge = Callable[
    [UInt8, list[FoundFruit], str], list[FoundFruit]
]  # finds in a picture, with scores for one kind


class CompactDetector:
    """Both networks, ready to run on the CPU, in the caller's thread.

    Args:
        finder: network for the whole picture, as `onnx_network` gives it.
        close_look: network for one fruit, as `onnx_network` gives it.
        scores: from the answers of both networks to the ratio of such detections that are fruit.
    """

    def __init__(
        self,
        finder: Network,
        close_look: Network,
        options: DetectorOptions | None = None,
        scores: Score | None = None,
    ) -> None:
        self.options, self.scores = options or DetectorOptions(), scores or PowerScore()
        self._finder = finder
        self._close_look = close_look
        self.judge: Judge = lambda _colour, found, _kind: found

    @classmethod
    def load(cls, path: Path | str, options: DetectorOptions | None = None) -> CompactDetector:
        """Load from a weights file, with ONNX Runtime as the engine.

        A file that is not a shipped one is judged, and tried in a process of its own, before it is loaded here.

        Raises BadWeights: unreadable or not fitting.
        """
        if Path(path).resolve().parent != SHIPPED:
            _tried(path)
        return cls._load(path, options)

    @classmethod
    def _load(cls, path: Path | str, options: DetectorOptions | None = None) -> CompactDetector:
        stored = read_weights(path)
        finder = onnx_network(stored.finder, path, FINDER)
        close_look = onnx_network(stored.close_look, path, CLOSE_LOOK)
        detector = cls(finder, close_look, options, stored.scores)
        kinds = Path(path).with_suffix(KINDS)
        for point in entry_points(group=DETECTORS, name="kinds") if kinds.is_file() else ():
            detector.judge = point.load()(kinds)
        return detector

    def looking(self, options: DetectorOptions) -> CompactDetector:
        """Return a detector of the same networks with other options."""
        other = copy.copy(self)
        other.options = options
        return other

    def warm_up(self, width: int = 640, height: int = 480) -> None:
        """Search an empty picture and take one look, so that the first picture is not slower than the rest."""
        blank = np.zeros((height, width, 3), np.uint8)
        self.places(blank, 1.0)
        K = np.array([[width, 0.0, 0.5 * width], [0.0, width, 0.5 * height], [0.0, 0.0, 1.0]])
        self.look(blank, K, [(K[:2, 2], 40.0)], self.options.mirrored)

    def find(self, colour: UInt8, K: Float64) -> list[FoundFruit]:
        """Find all fruit in a picture, by falling score.

        Args:
            colour: (h, w, 3) uint8 RGB.
            K: camera matrix (3, 3) [px].

        Raises:
            BadFrame: another shape or type.
        """
        seen = (
            self._look_at_all_widths(colour, K)
            if self.options.working_width is None
            else self._look_at_one_width(colour, K)
        )
        seen = sorted(self.judge(colour, seen, self.options.kind), key=lambda fruit: -fruit.score)
        centres = np.array([fruit.centre for fruit in seen]).reshape(-1, 2)
        sizes = np.array([f.size for f in seen])
        kept: list[int] = []
        for k in range(len(seen)):
            distances = np.linalg.norm(centres[kept] - centres[k], axis=1)
            if (distances > self.options.apart * np.maximum(sizes[kept], sizes[k])).all():
                kept.append(k)
        return [seen[k] for k in kept]

    def _look_at_one_width(self, colour: UInt8, K: Float64) -> list[FoundFruit]:
        """Return the fruit at the finder's places in a picture that is searched at one width."""
        places = self.places(colour, self.options.finder_threshold)[: self.options.most_fruit]
        seen, features = self._look_at_places(colour, K, places)
        judged = zip(places, seen, self.scores.of(features), strict=True)
        return [replace(fruit, score=float(score), box=place.box) for place, fruit, score in judged]

    def _look_at_places(
        self, colour: UInt8, K: Float64, places: list[Proposal]
    ) -> tuple[list[FoundFruit], Float64]:
        """Return the fruit at places, as yet without score and box, and the logits of their scores, (n, 4)."""
        if not places:
            return [], np.empty((0, FEATURES))
        options = self.options
        seen, kinds = self.look(
            colour,
            K,
            [(place.centre, place.size) for place in places],
            options.mirrored and options.looks == 1,
        )
        answers = zip(places, kinds, strict=True)
        features = np.array([[place.heat, place.quality, kind, kind] for place, kind in answers])
        for number in range(2, options.looks + 1):
            again = np.nonzero(self.scores.of(features) >= self.scores.hopeless)[0].tolist()
            if not again:
                break
            spots = [(seen[k].centre, seen[k].size) for k in again]
            better, kinds = self.look(
                colour, K, spots, options.mirrored and number == options.looks
            )
            for k, fruit, kind in zip(again, better, kinds, strict=True):
                seen[k], features[k, 3] = fruit, kind
        return seen, features

    def _look_at_all_widths(self, colour: UInt8, K: Float64) -> list[FoundFruit]:
        """Return the fruit in a picture that is searched at several widths: one look and one score for each place."""
        check_picture(colour)
        height, width = colour.shape[:2]
        sides = search_sides(width, height)
        found = list[list[Proposal]]()
        for side in sides:
            # the largest widths cost most: they are searched where a smaller one was sure of a fruit
            if side > LARGEST_WHOLE and not any(place.score >= 0.5 for place in found[-1]):
                break
            found.append(self.places_at(colour, side, self.options.finder_threshold))
        factors = np.array(sides[: len(found)]) / max(width, height)
        finds = [place for at_one in found for place in at_one]
        levels = np.repeat(np.arange(len(found)), [len(at_one) for at_one in found])
        boxes = np.array([place.box for place in finds]).reshape(-1, 4)
        merged = merge(boxes, np.array([place.score for place in finds]), levels, factors)[
            : self.options.most_fruit
        ]
        places = [
            Proposal(m.box, finds[m.members[0]].heat, finds[m.members[0]].quality) for m in merged
        ]
        seen, features = self._look_at_places(colour, K, places)
        fruit = []
        for place, one, logits in zip(merged, seen, features, strict=True):
            answers = np.array(
                [(finds[k].heat, finds[k].quality, *logits[2:]) for k in place.members]
            )
            scores = self.scores.of(answers)
            score = agreed_score(
                scores, levels[list(place.members)], float(place.box[2:].max()), factors
            )
            fruit.append(replace(one, score=score, box=place.box))
        return fruit

    def places(self, colour: UInt8, threshold: float) -> list[Proposal]:
        """Return the finder's places by its own falling score, in pixels of the picture.

        Raises:
            BadFrame: another shape or type.
        """
        maps, (width, _) = self.maps(colour)
        factor = colour.shape[1] / width
        return [
            place.scaled(factor)
            for place in read_places(maps, width, colour.shape[0] / factor, threshold)
        ]

    def places_at(self, colour: UInt8, side: int, threshold: float) -> list[Proposal]:
        """Return places of fruit of the sizes that are found well when the picture's longer side is shrunk to `side`.

        They are in pixels of the picture. A large input is searched in tiles.
        """
        height, width = colour.shape[:2]
        factor = max(width, height) / side
        shrunk = _shrunk(colour, max(1, round(width / factor)), max(1, round(height / factor)))
        places: list[Proposal] = []
        for tile in tiles(shrunk.shape[1], shrunk.shape[0]):
            part = shrunk[tile.top : tile.top + tile.height, tile.left : tile.left + tile.width]
            most = MOST_PEAKS * megapixels(tile.width, tile.height)
            found = read_places(self._maps_of(part), tile.width, tile.height, threshold, most)
            inside = [
                replace(place, box=place.box + np.array([tile.left, tile.top, 0.0, 0.0]))
                for place in found
            ]
            owned = tile.owns(np.array([place.box for place in inside]).reshape(-1, 4))
            places += [place for place, mine in zip(inside, owned, strict=True) if mine]
        sized = (
            place for place in places if SMALLEST_FRUIT <= place.box[2:].max() <= LARGEST_FRUIT
        )
        return [place.scaled(factor) for place in sized]

    def maps(self, colour: UInt8) -> tuple[Float32, tuple[int, int]]:
        """Return the finder's maps, shape (maps, h, w), and width and height of its input [px]. Raises BadFrame."""
        check_picture(colour)
        height, width = colour.shape[:2]
        working_width = self.options.working_width or WORKING_WIDTH
        small = (working_width, max(1, round(height * (working_width / width))))
        return self._maps_of(_shrunk(colour, *small)), small

    def _maps_of(self, picture: UInt8) -> Float32:
        """Return the finder's maps of a picture of the size at which it is searched."""
        below = -picture.shape[0] % FINDER_MULTIPLE
        right = -picture.shape[1] % FINDER_MULTIPLE
        if below or right:
            padded = cv2.copyMakeBorder(
                picture, 0, below, 0, right, cv2.BORDER_CONSTANT, value=(114, 114, 114)
            )
            picture = np.asarray(padded, np.uint8)
        maps: Float32 = self._finder(_input(picture[None]))[0][0]
        return maps

    def look(
        self, colour: UInt8, K: Float64, places: list[tuple[Float64, float]], mirrored: bool
    ) -> tuple[list[FoundFruit], list[float]]:
        """Return fruit at centres and sizes [px], as yet without score, and the logits of being fruit."""
        side = (CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
        looks = [look_at(K, centre, size) for centre, size in places]
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        pictures = np.stack(
            [
                cv2.warpPerspective(colour, look.picture_from_look, side, flags=flags)
                for look in looks
            ]
        )
        if mirrored:
            pictures = np.concatenate([pictures, pictures[:, :, ::-1]])
        parts = np.array_split(pictures, -(-len(pictures) // BATCH))
        output = np.concatenate([self._close_look(_input(part))[0] for part in parts]).astype(
            np.float64
        )
        if mirrored:
            output = 0.5 * (output[: len(looks)] + output[len(looks) :] * MIRROR)
        found = []
        for row, look in zip(output, looks, strict=True):
            p_camera, stem = look.place(row[: SPREAD.start])
            # A fruit beside the look cannot be placed behind the camera, however wide the look.
            p_camera[2] = max(p_camera[2], 1e-3)
            size = K[0, 0] * REFERENCE_LENGTH / p_camera[2]
            centre = p_camera[:2] / p_camera[2] * (K[0, 0], K[1, 1]) + K[:2, 2]
            half = 0.5 * CLOSE_LOOK_SIZE * K[0, 0] / look.focal
            spreads = np.exp(np.clip(row[SPREAD], -6.0, 2.0)) * (half, 1.0, 1.0)
            seen = float(1.0 / (1.0 + np.exp(-row[SEEN])))
            found.append(FoundFruit(p_camera, stem, centre, size, spreads, 0.0, seen))
        return found, output[:, KIND].tolist()


def try_weights(path: str) -> None:
    """Load a weights file and search an empty picture; runs in a process of its own. Raises BadWeights."""
    CompactDetector._load(path).warm_up()


def _tried(path: Path | str) -> None:
    stored = read_weights(path)
    judge_network(stored.finder, path, FINDER)
    judge_network(stored.close_look, path, CLOSE_LOOK)
    problem = trial(f"{__name__}:{try_weights.__name__}", str(path))
    if problem:
        raise BadWeights(path, problem)


def _shrunk(colour: UInt8, width: int, height: int) -> UInt8:
    """Return a picture at another size [px]."""
    flag = cv2.INTER_AREA if width < colour.shape[1] else cv2.INTER_LINEAR
    return np.asarray(
        cv2.resize(np.ascontiguousarray(colour), (width, height), interpolation=flag), np.uint8
    )


def _input(pictures: UInt8) -> Float32:
    """uint8 pictures (n, h, w, 3) as a network's input (n, 3, h, w)."""
    planes = np.ascontiguousarray(pictures.transpose(0, 3, 1, 2))
    return planes * np.float32(1.0 / 255.0) - np.float32(0.5)
