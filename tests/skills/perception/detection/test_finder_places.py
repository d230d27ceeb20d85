"""Reading the finder's maps, against the targets that they are learnt from."""

import time

import numpy as np
import pytest

from pomona.skills.perception.detection.close_look import SIZE_OF_BOX
from pomona.skills.perception.detection.errors import BadMaps
from pomona.skills.perception.detection.finder_places import MOST_PEAKS, Proposal, read_places
from pomona.skills.perception.detection.outputs import HEAT, QUALITY, REACHES
from pomona.tools.training import targets
from pomona.tools.training.targets import finder_targets


def maps_of(boxes: np.ndarray, height: int = 60, width: int = 80) -> np.ndarray:
    """Return the maps of a perfect finder, with boxes x, y, w, h [px]."""
    wanted = finder_targets(boxes / 4.0, np.ones(len(boxes), np.bool_), height, width)
    maps = np.zeros((6, height, width), np.float32)
    heat = np.clip(wanted[targets.HEAT], 1e-4, 0.99)
    maps[HEAT], maps[QUALITY] = np.log(heat / (1.0 - heat)), 3.0
    maps[REACHES] = np.log(np.maximum(wanted[targets.REACHES], 0.01))
    return maps


def test_boxes_are_read_as_they_were_drawn() -> None:
    boxes = np.array([[40.0, 20.0, 50.0, 44.0], [200.0, 100.0, 31.0, 60.0], [300.0, 210.0, 20.0, 30.0]])
    found = read_places(maps_of(boxes), 320.0, 240.0)
    assert len(found) == 3
    for box in boxes:
        best = min(found, key=lambda place: float(np.abs(place.box - box).max()))
        assert best.box == pytest.approx(box, abs=1e-3)
        assert best.centre == pytest.approx(box[:2] + 0.5 * box[2:] - 0.5, abs=1e-3)
        assert best.size == pytest.approx(SIZE_OF_BOX * box[2:].max(), rel=1e-3)


def test_boxes_end_at_the_border_of_the_picture() -> None:
    (place,) = read_places(maps_of(np.array([[290.0, 200.0, 40.0, 50.0]])), 318.0, 236.0)
    assert place.box == pytest.approx([290.0, 200.0, 28.0, 36.0], abs=1e-3)


def test_the_score_is_the_geometric_mean_of_heat_and_quality() -> None:
    place = Proposal(np.array([0.0, 0.0, 9.0, 9.0]), np.log(0.64 / 0.36), np.log(0.25 / 0.75))
    assert place.score == pytest.approx(np.sqrt(0.64 * 0.25))
    assert place.scaled(2.0).box.tolist() == [0.0, 0.0, 18.0, 18.0]


def test_a_second_box_on_the_same_fruit_is_dropped() -> None:
    maps = maps_of(np.array([[100.0, 80.0, 48.0, 48.0]]))
    v, u = np.unravel_index(int(np.argmax(maps[HEAT])), maps[HEAT].shape)
    maps[HEAT, v, u + 3] = maps[HEAT, v, u] - 1.0
    maps[REACHES, v, u + 3] = np.log([9.0, 6.0, 3.0, 6.0])
    assert len(read_places(maps, 320.0, 240.0)) == 1
    maps[REACHES, v, u + 3] = np.log([1.0, 6.0, 6.0, 6.0])  # another fruit beside it
    assert len(read_places(maps, 320.0, 240.0)) == 2


@pytest.mark.parametrize("value", [0.0, 1.0, 1e4, -1e4, np.nan, np.inf])
def test_hostile_maps_return_at_once(value: float) -> None:
    start = time.process_time()
    found = read_places(np.full((6, 60, 80), value, np.float32), 320.0, 240.0)
    assert time.process_time() - start < 1.0
    assert len(found) <= MOST_PEAKS
    assert all(np.isfinite(place.box).all() for place in found)


def test_maps_of_another_number_are_refused() -> None:
    with pytest.raises(BadMaps, match=r"finder maps \(6, h, w\)"):
        read_places(np.zeros((9, 4, 4), np.float32), 16.0, 16.0)
