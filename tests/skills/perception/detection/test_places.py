"""Search at several widths: which, in which tiles, and one place and one score from all of them."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from pomona.skills.perception.detection.close_look import HEAT, QUALITY, REACHES, SIZE_OF_BOX
from pomona.skills.perception.detection.errors import BadMaps
from pomona.skills.perception.detection.places import (
    CLOSEST,
    INSIDE,
    LARGEST_FRUIT,
    LARGEST_SIDE,
    LARGEST_WHOLE,
    MOST_PEAKS,
    SAME,
    SMALLEST_FRUIT,
    SURE_LARGEST,
    SURE_SMALLEST,
    TILE,
    MergedPlace,
    Proposal,
    agreed_score,
    iou,
    merge,
    read_places,
    search_sides,
    tiles,
    width_for,
)
from pomona.tools.training import targets
from pomona.tools.training.targets import finder_targets

SIDES = st.integers(32, 12_000)
FACTORS = np.array([0.1, 0.14, 0.2, 0.28, 0.4, 0.56, 0.8, 1.0])


@st.composite
def finds(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Boxes, scores and levels of up to a dozen finds, often of the same few fruit."""
    count = draw(st.integers(0, 12))
    unit = st.floats(0.0, 1.0)
    fruit = [
        (draw(st.floats(0, 900)), draw(st.floats(0, 900)), draw(st.floats(30, 300)))
        for _ in range(3)
    ]
    boxes = []
    for _ in range(count):
        x, y, side = draw(st.sampled_from(fruit))
        shift = 0.6 * side * (draw(unit) - 0.5)
        boxes.append(
            [x + shift, y + shift, side * (0.4 + 0.8 * draw(unit)), side * (0.4 + 0.8 * draw(unit))]
        )
    scores = np.array([draw(st.floats(0.01, 1.0)) for _ in range(count)])
    levels = np.array([draw(st.integers(0, len(FACTORS) - 1)) for _ in range(count)], np.int64)
    return np.array(boxes).reshape(-1, 4), scores, levels


@given(SIDES, SIDES)
def test_widths_rise_to_the_pictures_own_and_never_beyond(width: int, height: int) -> None:
    sides = search_sides(width, height)
    assert sides[-1] == min(max(width, height), LARGEST_SIDE)
    ratios = np.array(sides[1:]) / np.array(sides[:-1])
    assert (ratios >= CLOSEST).all()
    assert (ratios < 2.0).all()
    assert search_sides(height, width) == sides


@given(SIDES, SIDES, st.floats(0.0, 1.0))
def test_fruit_of_every_findable_size_is_searched_at_a_width_that_finds_it(
    width: int, height: int, part: float
) -> None:
    sides = search_sides(width, height)
    longer = max(width, height)
    low = SMALLEST_FRUIT * longer / max(sides)
    high = min(longer, LARGEST_FRUIT * longer / min(sides))
    assume(low <= high)
    in_inputs = (low * (high / low) ** part) * np.array(sides) / max(width, height)
    assert ((in_inputs >= SMALLEST_FRUIT - 1e-6) & (in_inputs <= LARGEST_FRUIT + 1e-6)).any()
    if in_inputs[-1] >= SURE_SMALLEST and in_inputs[0] <= SURE_LARGEST:
        assert ((in_inputs >= SURE_SMALLEST) & (in_inputs <= SURE_LARGEST)).any()


@given(
    st.integers(8, 4096),
    st.integers(8, 4096),
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(1, LARGEST_FRUIT),
)
def test_every_fruit_counts_in_one_tile_and_lies_whole_in_it(
    width: int, height: int, across: float, down: float, side: float
) -> None:
    low = np.array([across * (width - 1), down * (height - 1)])
    box = np.append(low, np.minimum(side, [width, height] - low))
    owners = [tile for tile in tiles(width, height) if tile.owns(box[None])[0]]
    (tile,) = owners
    assert tile.left <= box[0]
    assert tile.top <= box[1]
    assert box[0] + box[2] <= tile.left + tile.width
    assert box[1] + box[3] <= tile.top + tile.height


@given(st.integers(8, 4096), st.integers(8, 4096))
def test_tiles_lie_in_the_picture_and_are_small(width: int, height: int) -> None:
    cut = tiles(width, height)
    for tile in cut:
        assert tile.left >= 0
        assert tile.top >= 0
        assert tile.left + tile.width <= width
        assert tile.top + tile.height <= height
        assert max(tile.width, tile.height) <= (TILE if len(cut) > 1 else LARGEST_WHOLE)


@given(finds())
def test_merged_places_are_apart_and_each_find_is_at_one_of_them(
    given_finds: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    boxes, scores, levels = given_finds
    places = merge(boxes, scores, levels, FACTORS)
    kept = [place.members[0] for place in places]
    overlap = iou(boxes, boxes)
    for n, k in enumerate(kept):
        assert (overlap[k, kept[:n]] < SAME).all()
    assert list(scores[kept]) == sorted(scores[kept], reverse=True)
    for k in range(len(boxes)):
        assert any(
            overlap[k, j] >= SAME or part_inside(boxes[k], boxes[j]) >= INSIDE - 1e-9 for j in kept
        )


@given(finds())
def test_a_merged_place_lies_among_its_members_of_different_widths(
    given_finds: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    boxes, scores, levels = given_finds
    places = merge(boxes, scores, levels, FACTORS)
    all_members = [k for place in places for k in place.members]
    assert len(set(all_members)) == len(all_members)
    for place in places:
        mine = boxes[list(place.members)]
        assert len(set(levels[list(place.members)])) == len(place.members)
        assert (place.box[:2] >= mine[:, :2].min(axis=0) - 1e-6).all()
        assert (
            place.box[:2] + place.box[2:] <= (mine[:, :2] + mine[:, 2:]).max(axis=0) + 1e-6
        ).all()


@given(finds(), st.floats(0.2, 5.0), st.floats(-50, 50))
def test_a_picture_that_is_moved_and_scaled_gives_places_that_are_moved_and_scaled(
    given_finds: tuple[np.ndarray, np.ndarray, np.ndarray], scale: float, shift: float
) -> None:
    boxes, scores, levels = given_finds
    assume(
        all(
            abs(value - limit) > 1e-6 for value in iou(boxes, boxes).ravel() for limit in (0.5, 0.6)
        )
    )
    assume(
        all(
            abs(part_inside(a, b) - INSIDE) > 1e-6 for a in boxes for b in boxes
        )
    )  # fmt: skip
    before = merge(boxes, scores, levels, FACTORS)
    other = boxes * scale + (shift, shift, 0.0, 0.0)
    after = merge(other, scores, levels, FACTORS / scale)
    assert [place.members for place in after] == [place.members for place in before]
    for old, new in zip(before, after, strict=True):
        assert new.box == pytest.approx(old.box * scale + (shift, shift, 0.0, 0.0), abs=1e-6)


def test_a_part_of_a_large_apple_is_no_second_one() -> None:
    apple, part = [100.0, 100.0, 200.0, 200.0], [120.0, 120.0, 60.0, 60.0]
    (place,) = merge(np.array([part, apple]), np.array([0.6, 0.9]), np.array([5, 1]), FACTORS)
    assert isinstance(place, MergedPlace)
    assert place.members == (1,)


def test_boxes_of_several_widths_are_averaged_toward_that_of_the_best_size() -> None:
    boxes = np.array([[100.0, 100.0, 100.0, 100.0], [110.0, 100.0, 100.0, 100.0]])
    (place,) = merge(boxes, np.array([0.9, 0.9]), np.array([0, 1]), np.array([0.5, 1.3]))
    assert place.members == (0, 1)
    assert 100.0 < place.box[0] < 105.0  # 50 px in the first input, 130 px in the second


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8), st.floats(5.0, 2000.0))
def test_a_score_is_at_most_the_best_and_one_where_all_widths_are_sure(
    scores: list[float], size: float
) -> None:
    levels = np.arange(len(scores))
    score = agreed_score(np.array(scores), levels, size, FACTORS)
    assert 0.0 <= score <= max(scores) + 1e-12
    assert agreed_score(
        np.ones(len(FACTORS)), np.arange(len(FACTORS)), size, FACTORS
    ) == pytest.approx(1.0)


@given(st.integers(0, 7), st.integers(0, 7), st.floats(0.01, 1.0), st.floats(30.0, 1000.0))
def test_another_width_that_finds_the_fruit_never_lowers_its_score(
    a: int, b: int, second: float, size: float
) -> None:
    assume(a != b)
    alone = agreed_score(np.array([0.9]), np.array([a]), size, FACTORS)
    assert agreed_score(np.array([0.9, second]), np.array([a, b]), size, FACTORS) >= alone - 1e-12


def test_a_miss_counts_only_at_widths_where_the_fruit_is_of_a_sure_size() -> None:
    factors = np.array([0.25, 1.0])  # 20 px and 80 px in the inputs
    assert agreed_score(np.array([0.8]), np.array([1]), 80.0, factors) == pytest.approx(0.8)
    factors = np.array([0.5, 1.0])  # 40 px and 80 px
    assert agreed_score(np.array([0.8]), np.array([1]), 80.0, factors) == pytest.approx(
        0.8 * np.sqrt(0.5)
    )
    assert (
        agreed_score(np.array([0.8]), np.array([0]), 26.0, np.array([1.0])) == 0.8
    )  # no width finds it surely


def test_the_width_for_a_distance_shows_an_apple_as_large_as_the_finder_learnt_it() -> None:
    assert width_for(0.5, 0.075, 610.6, 640) == pytest.approx(321, abs=1)
    assert width_for(5.0, 0.075, 610.6, 640) == 640, "never enlarged"
    assert width_for(0.01, 0.075, 610.6, 640) == 64


def part_inside(a: np.ndarray, b: np.ndarray) -> float:
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[:2] + a[2:], b[:2] + b[2:])
    shared = float(np.clip(high - low, 0.0, None).prod())
    return shared / float(min(a[2:].prod(), b[2:].prod()))


def maps_of(boxes: np.ndarray, height: int = 60, width: int = 80) -> np.ndarray:
    """Return the maps of a perfect finder, with boxes x, y, w, h [px]."""
    wanted = finder_targets(boxes / 4.0, np.ones(len(boxes), np.bool_), height, width)
    maps = np.zeros((6, height, width), np.float32)
    heat = np.clip(wanted[targets.HEAT], 1e-4, 0.99)
    maps[HEAT], maps[QUALITY] = np.log(heat / (1.0 - heat)), 3.0
    maps[REACHES] = np.log(np.maximum(wanted[targets.REACHES], 0.01))
    return maps


def test_boxes_are_read_as_they_were_drawn() -> None:
    boxes = np.array(
        [[40.0, 20.0, 50.0, 44.0], [200.0, 100.0, 31.0, 60.0], [300.0, 210.0, 20.0, 30.0]]
    )
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
