"""Peaks and offsets of the finder's maps."""

import time

import numpy as np
import pytest

from pomona.skills.perception.detection.close_look import SIZE_OF_BOX
from pomona.skills.perception.detection.errors import BadMaps
from pomona.skills.perception.detection.outputs import OFFSET_UNIT
from pomona.skills.perception.detection.peaks import MOST_PEAKS, decode_offsets
from pomona.skills.perception.training.targets import box_targets, finder_targets


def keypoints_at(centre: tuple[float, float], size: float = 9.0) -> np.ndarray:
    angles = np.arange(8) * np.pi / 4 + 0.2
    return np.vstack([np.asarray(centre) + size * np.stack([np.cos(angles), np.sin(angles)], axis=1), [centre]])


def test_training_targets_decode_to_the_keypoints_they_were_drawn_from() -> None:
    cells = np.stack([keypoints_at((20.3, 15.7)), keypoints_at((55.6, 40.2), 6.0)])
    boxes = np.array([[10.0, 6.5, 21.0, 18.0], [49.0, 35.0, 12.5, 11.0]])
    maps = finder_targets(cells, np.array([1.0, 0.7]), 60, 80, boxes)
    found = decode_offsets(maps.belief, maps.offsets, 0.3, reaches=maps.reaches)
    assert len(found) == 2
    for place in found:
        points = place.keypoints
        nearest = int(np.argmin(np.linalg.norm((cells[:, 8] + 0.5) * 4 - 0.5 - points[8], axis=1)))
        truth = cells[nearest]
        assert np.allclose(points, (truth + 0.5) * 4 - 0.5, atol=0.02)
        assert np.isclose(place.size, 4 * np.linalg.norm(truth[:8] - truth[8], axis=1).mean(), rtol=1e-3)
        assert place.belief > 0.9
        assert place.box == pytest.approx(4.0 * boxes[nearest], abs=1e-3)
    square = decode_offsets(maps.belief, maps.offsets, 0.3)[0]
    assert square.box is None
    assert square.outline[2] == square.outline[3] == pytest.approx(square.size / SIZE_OF_BOX)


def test_fruit_whose_middle_the_border_hides_is_asked_for_at_the_border() -> None:
    box = np.array([[0.0, 20.0, 4.0, 18.0]])
    rendered = finder_targets(keypoints_at((-4.0, 28.5))[None], np.array([0.4]), 60, 80, box)
    drawn = box_targets(np.array([[-4.0, 28.5]]), np.array([9.0]), box, np.array([True]), 60, 80)
    for maps in (rendered, drawn):
        assert np.argwhere(maps.peak[0]).tolist() == [[28, 0]]
        (place,) = decode_offsets(maps.belief, maps.offsets, 0.3, reaches=maps.reaches)
        assert place.box == pytest.approx(4.0 * box[0], abs=0.1)
        assert maps.reach_weight.sum() == pytest.approx(1.0, abs=0.05)


def test_hidden_fruit_is_neither_asked_for_nor_punished() -> None:
    cells = keypoints_at((40.0, 30.0))[None]
    maps = finder_targets(cells, np.array([0.1]), 60, 80, np.array([[30.0, 20.0, 20.0, 20.0]]))
    assert maps.belief.max() == maps.peak.max() == 0.0
    assert maps.weight[0, 30, 40] == 0.0
    assert maps.weight[0, 5, 5] == 1.0
    assert maps.offset_weight.max() == maps.reach_weight.max() == 0.0


def test_a_weaker_peak_on_the_same_fruit_is_dropped() -> None:
    belief, offsets = np.zeros((9, 60, 80), np.float32), np.zeros((17, 60, 80), np.float32)
    arms = np.append((keypoints_at((0.0, 0.0), 12.0)[:8] / OFFSET_UNIT).reshape(16), np.log(12.0 / OFFSET_UNIT))
    for u, value in ((30, 0.9), (34, 0.6), (60, 0.5)):
        belief[8, 30, u] = value
        offsets[:, 30, u] = arms
    assert [round(p.belief, 2) for p in decode_offsets(belief, offsets, 0.3)] == [0.9, 0.5]


@pytest.mark.parametrize("value", [0.0, 1.0, np.nan, np.inf])
def test_hostile_maps_return_at_once(value: float) -> None:
    start = time.process_time()
    found = decode_offsets(np.full((9, 60, 80), value, np.float32), np.full((17, 60, 80), value, np.float32), 0.3)
    assert time.process_time() - start < 1.0
    assert len(found) <= MOST_PEAKS
    assert all(np.isfinite(p.keypoints).all() and np.isfinite(p.size) for p in found)


def test_maps_of_other_shapes_are_refused() -> None:
    with pytest.raises(BadMaps, match=r"offsets \(17, h, w\)"):
        decode_offsets(np.zeros((9, 4, 4), np.float32), np.zeros((17, 4, 5), np.float32), 0.3)
