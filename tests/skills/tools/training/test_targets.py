"""The finder's targets: peaks, boxes, and cells that do not count."""

import numpy as np

from pomona.tools.training.targets import BOX_WEIGHT, HEAT, PEAK, REACHES, WEIGHT, finder_targets


def test_each_fruit_has_one_peak_in_the_middle_and_its_box_around() -> None:
    boxes = np.array([[4.0, 6.0, 10.0, 8.0], [20.25, 3.5, 5.5, 12.0]])
    maps = finder_targets(boxes, np.ones(2, np.bool_), 20, 30)
    assert np.argwhere(maps[PEAK]).tolist() == [[9, 23], [10, 9]]
    for x, y, w, h in boxes:
        u, v = int(x + w / 2), int(y + h / 2)
        left, up, right, down = maps[REACHES, v, u]
        assert np.allclose([u + 0.5 - left, v + 0.5 - up, left + right, up + down], [x, y, w, h])
        assert maps[HEAT, v, u] == maps[BOX_WEIGHT, v, u] == 1.0
    assert (maps[WEIGHT] == 1.0).all()
    assert (maps[BOX_WEIGHT] <= maps[HEAT]).all()


def test_a_box_that_is_not_taught_is_neither_fruit_nor_background() -> None:
    boxes = np.array([[4.0, 6.0, 10.0, 8.0], [12.0, 8.0, 6.0, 6.0]])
    maps = finder_targets(boxes, np.array([False, True]), 20, 30)
    assert maps[PEAK].sum() == 1.0
    assert maps[WEIGHT, 10, 6] == 0.0
    assert maps[WEIGHT, 1, 1] == 1.0
    assert maps[WEIGHT, 11, 15] == 1.0  # the taught one keeps its peak
    assert finder_targets(np.empty((0, 4)), np.empty(0, np.bool_), 4, 5)[HEAT].max() == 0.0


def test_the_smaller_of_two_boxes_wins_where_both_lie() -> None:
    boxes = np.array([[10.0, 10.0, 4.0, 4.0], [2.0, 2.0, 20.0, 20.0]])
    maps = finder_targets(boxes, np.ones(2, np.bool_), 24, 24)
    left, _, right, _ = maps[REACHES, 12, 12]
    assert left + right == 4.0
