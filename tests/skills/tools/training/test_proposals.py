"""Labels that are proposed from recorded frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.detection import DetectorOptions
from pomona.skills.perception.detection.instances import FoundFruit
from pomona.skills.perception.fruit import load_fruit
from pomona.tools.photographs.photo_folder import read_photographs
from pomona.tools.training.proposals import RecordedLook, propose, write_proposals
from tests.skills.tools.box_detectors.test_box_detector import K, ball, box_of

CENTRES = [(-0.15, 0.0, 0.5), (0.0, 0.0, 0.5), (0.15, 0.0, 0.5)]


class Scripted:
    """A detector of given boxes and scores."""

    options = DetectorOptions()

    def __init__(self, *found: tuple[np.ndarray, float]) -> None:
        self._found = found

    def looking(self, options: DetectorOptions) -> Scripted:
        assert options.finder_threshold == 0.2
        return self

    def find(self, colour: np.ndarray, K: np.ndarray) -> list[FoundFruit]:
        up = np.array([0.0, -1.0, 0.0])
        return [
            FoundFruit(np.zeros(3), up, box[:2], 30.0, np.ones(3), score, 0.9, box)
            for box, score in self._found
        ]


@pytest.fixture
def scene() -> tuple[np.ndarray, list[np.ndarray]]:
    """Depth of three balls before a wall, and their boxes."""
    depths = [ball(np.array(centre), 0.045) for centre in CENTRES]
    return np.minimum.reduce(depths), [box_of(depth) for depth in depths]


def a_look(
    depth: np.ndarray, picked: tuple[float, float] | None = None, run: str = "a"
) -> RecordedLook:
    places = np.empty((0, 2)) if picked is None else np.array([picked])
    return RecordedLook(run, np.zeros((480, 640, 3), np.uint8), depth, K, places)


def test_a_label_needs_a_score_and_the_depth_of_a_fruit(
    scene: tuple[np.ndarray, list[np.ndarray]],
) -> None:
    depth, boxes = scene
    flat = depth.copy()
    x, y, w, h = boxes[2].astype(int)
    flat[y : y + h, x : x + w : 2] = 0.9  # no fruit's shape
    detector = Scripted((boxes[0], 0.9), (boxes[1], 0.4), (boxes[2], 0.9), (boxes[0], 0.1))
    proposed = propose(detector, a_look(flat), load_fruit("apple"))  # type: ignore[arg-type]
    assert proposed.doubtful.tolist() == [False, True, True]
    assert np.array_equal(proposed.boxes, np.stack(boxes))


def test_a_fruit_that_was_picked_is_a_label_whatever_its_score(
    scene: tuple[np.ndarray, list[np.ndarray]],
) -> None:
    depth, boxes = scene
    middle = boxes[1][:2] + 0.5 * boxes[1][2:]
    look = a_look(np.zeros_like(depth), (float(middle[0]), float(middle[1])))
    proposed = propose(Scripted((boxes[0], 0.9), (boxes[1], 0.15)), look, load_fruit("apple"))  # type: ignore[arg-type]
    assert proposed.doubtful.tolist() == [True, False]


def test_proposals_are_read_as_photographs_and_one_run_in_four_is_measured_on(
    scene: tuple[np.ndarray, list[np.ndarray]], tmp_path: Path
) -> None:
    depth, boxes = scene
    looks = [a_look(depth, run=run) for run in ("a", "a", "b", "c", "d")]
    detector: CompactDetector = Scripted((boxes[0], 0.9), (boxes[1], 0.4))  # type: ignore[assignment]
    assert write_proposals(tmp_path / "p", looks, detector, load_fruit("apple")) == (5, 5)
    photographs = read_photographs(tmp_path / "p")
    assert (len(photographs.train), len(photographs.val)) == (4, 1)
    assert photographs.train[0].crowd.tolist() == [False, True]
    assert np.allclose(photographs.val[0].boxes, np.stack(boxes[:2]))
