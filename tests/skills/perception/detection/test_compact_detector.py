"""The compact detector with networks that answer what the test says, instead of the trained ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pomona.skills.perception.detection.close_look import (
    AXIS,
    CENTRE,
    CLOSE_LOOK_OUTPUTS,
    CLOSE_LOOK_SIZE,
    FINDER_MULTIPLE,
    KIND,
    LEAST_SIDE,
    REFERENCE_LENGTH,
    SEEN,
    SPREAD,
    check_picture,
)
from pomona.skills.perception.detection.compact_detector import (
    BATCH,
    CompactDetector,
    _input,
    _shrunk,
)
from pomona.skills.perception.detection.detection import DetectorOptions
from pomona.skills.perception.detection.errors import BadFrame
from pomona.skills.perception.detection.instances import FoundFruit
from pomona.skills.perception.detection.places import FINDER_STRIDE

K = np.array([[200.0, 0.0, 63.5], [0.0, 200.0, 47.5], [0.0, 0.0, 1.0]])
COLOUR = np.full((96, 128, 3), 90, np.uint8)
OPTIONS = DetectorOptions(working_width=128, mirrored=False, looks=1, finder_threshold=0.1)


class Finder:
    """Heat at cells (row, column) of its maps, in a field without any."""

    def __init__(self, *cells: tuple[int, int, float], reach: float = 1.0) -> None:
        """`reach`: of each place's box, each way [cells]."""
        self.cells, self.reach, self.inputs = cells, reach, list[Any]()

    def __call__(self, pictures: Any) -> list[Any]:
        self.inputs.append(pictures)
        rows, columns = (side // FINDER_STRIDE for side in pictures.shape[2:])
        maps = np.full((1, 6, rows, columns), -9.0, np.float32)
        maps[0, 1:5] = np.log(self.reach)
        for row, column, heat in self.cells:
            maps[0, 0, row, column], maps[0, 5, row, column] = heat, 3.0
        return [maps]


class CloseLook:
    """The same answer to every look."""

    def __init__(self, **answer: Any) -> None:
        self.row = np.zeros(CLOSE_LOOK_OUTPUTS)
        self.row[AXIS] = 0.0, -1.0, 0.0
        self.row[KIND] = 4.0
        for name, value in answer.items():
            self.row[{"centre": CENTRE, "kind": KIND, "seen": SEEN, "spread": SPREAD}[name]] = value
        self.batches: list[int] = []

    def __call__(self, pictures: Any) -> list[Any]:
        assert pictures.shape[1:] == (3, CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
        self.batches.append(len(pictures))
        return [np.tile(self.row, (len(pictures), 1))]


def detector(
    finder: Finder | None = None, close_look: CloseLook | None = None, **options: Any
) -> CompactDetector:
    return CompactDetector(
        finder or Finder(), close_look or CloseLook(), replace(OPTIONS, **options)
    )


def test_a_place_is_where_the_finders_heat_is() -> None:
    found = detector(Finder((5, 9, 4.0))).places(COLOUR, 0.1)
    (place,) = found
    middle = (np.array([9.5, 5.5])) * FINDER_STRIDE
    assert place.box[:2] + 0.5 * place.box[2:] == pytest.approx(middle)
    assert place.box[2:] == pytest.approx([2.0 * FINDER_STRIDE] * 2)
    assert (place.heat, place.quality) == (4.0, 3.0)
    assert detector(Finder((5, 9, 4.0))).places(COLOUR, 0.99) == []


def test_a_wide_picture_is_searched_small_and_its_places_are_its_own() -> None:
    finder = Finder((5, 9, 4.0))
    wide = np.full((192, 256, 3), 90, np.uint8)
    (place,) = detector(finder).places(wide, 0.1)
    assert finder.inputs[0].shape == (1, 3, 96, 128)
    middle = 2.0 * np.array([9.5, 5.5]) * FINDER_STRIDE
    assert place.box[:2] + 0.5 * place.box[2:] == pytest.approx(middle)


def test_a_picture_is_padded_to_whole_multiples_with_grey_below_and_at_the_right() -> None:
    finder = Finder()
    odd = np.zeros((97, 126, 3), np.uint8)
    maps, size = detector(finder, working_width=126).maps(odd)
    (seen,) = finder.inputs
    height, width = seen.shape[2:]
    assert size == (126, 97)
    assert height % FINDER_MULTIPLE == width % FINDER_MULTIPLE == 0
    assert 0 <= height - 97 < FINDER_MULTIPLE
    assert 0 <= width - 126 < FINDER_MULTIPLE
    assert (seen[0, :, :97, :126] == -0.5).all()
    assert seen[0, :, 97:] == pytest.approx(114.0 / 255.0 - 0.5)
    assert seen[0, :, :, 126:] == pytest.approx(114.0 / 255.0 - 0.5)
    assert maps.shape == (6, height // FINDER_STRIDE, width // FINDER_STRIDE)


def test_a_networks_input_has_planes_of_colour_about_zero() -> None:
    picture = np.zeros((1, 2, 3, 3), np.uint8)
    picture[0, 1, 2] = 255, 51, 0
    made = _input(picture)
    assert made.shape == (1, 3, 2, 3)
    assert made[0, :, 1, 2] == pytest.approx([0.5, -0.3, -0.5])


@pytest.mark.parametrize(("width", "height"), [(4, 3), (16, 12)])
def test_pictures_are_shrunk_by_means_and_enlarged_between_pixels(width: int, height: int) -> None:
    picture = np.zeros((6, 8, 3), np.uint8)
    picture[::2, ::2] = 200
    made = _shrunk(picture, width, height)
    assert made.shape == (height, width, 3)
    if width < 8:
        assert (made == 50).all()  # one of four pixels
    else:
        assert 0 < made.mean() < 100
        assert made.max() > 100


def test_a_fruit_is_where_the_close_look_says() -> None:
    close = CloseLook(seen=0.0, spread=(0.0, -9.0, 9.0))
    (fruit,) = detector(Finder((5, 9, 4.0)), close).find(COLOUR, K)
    middle = np.array([9.5, 5.5]) * FINDER_STRIDE - 0.5
    assert fruit.centre == pytest.approx(middle)  # the look's own middle
    z = fruit.p_camera[2]
    assert fruit.p_camera == pytest.approx(z * (np.linalg.inv(K) @ [*middle, 1.0]))
    assert fruit.size == pytest.approx(200.0 * REFERENCE_LENGTH / z)
    assert fruit.visibility == pytest.approx(0.5)
    assert fruit.spreads[1:] == pytest.approx(np.exp([-6.0, 2.0]))
    assert np.linalg.norm(fruit.stem) == pytest.approx(1.0)
    assert 0.0 < fruit.score < 1.0
    assert fruit.box is not None
    assert fruit.box[2:] == pytest.approx([2.0 * FINDER_STRIDE] * 2)


@pytest.mark.parametrize(("x", "side"), [(0.2, 1.0), (-0.2, -1.0)])
def test_a_mirrored_look_answers_for_the_mirror(x: float, side: float) -> None:
    """The same answer to a picture and to its mirror places the fruit in the middle."""
    straight = detector(Finder((5, 7, 4.0)), CloseLook(centre=(x, 0.1)))
    mirrored = detector(Finder((5, 7, 4.0)), CloseLook(centre=(x, 0.1)), mirrored=True)
    middle = np.array([7.5, 5.5]) * FINDER_STRIDE - 0.5
    beside, between = straight.find(COLOUR, K)[0].centre, mirrored.find(COLOUR, K)[0].centre
    assert side * (beside[0] - middle[0]) > 1.0
    assert between[0] == pytest.approx(middle[0], abs=0.05)
    assert beside[1] > middle[1] + 0.5
    assert between[1] > middle[1] + 0.5


@pytest.mark.parametrize(
    ("looks", "mirrored", "batches"),
    [(1, False, [1]), (1, True, [2]), (2, False, [1, 1]), (2, True, [1, 2]), (3, True, [1, 1, 2])],
)
def test_every_fruit_gets_its_looks_and_the_last_one_a_mirror(
    looks: int, mirrored: bool, batches: list[int]
) -> None:
    close = CloseLook()
    made = detector(Finder((5, 9, 4.0)), close, looks=looks, mirrored=mirrored)
    made.find(COLOUR, K)
    assert close.batches == batches


def test_a_place_that_is_hopeless_gets_no_second_look() -> None:
    close = CloseLook(kind=-12.0)
    detector(Finder((5, 9, 4.0)), close, looks=3).find(COLOUR, K)
    assert close.batches == [1]


def test_looks_go_through_the_network_in_batches() -> None:
    close = CloseLook()
    spots = [(np.array([60.0, 50.0]), 20.0)] * (BATCH + 1)
    detector(close_look=close).look(COLOUR, K, spots, mirrored=False)
    assert sum(close.batches) == BATCH + 1
    assert len(close.batches) == 2
    close.batches.clear()
    detector(close_look=close).look(COLOUR, K, spots[:BATCH], mirrored=False)
    assert close.batches == [BATCH]


def test_no_place_gives_no_fruit_and_no_look() -> None:
    close = CloseLook()
    assert detector(Finder(), close).find(COLOUR, K) == []
    assert close.batches == []


def test_the_most_fruit_are_the_surest() -> None:
    cells = (2, 3, 2.0), (2, 12, 5.0), (9, 8, 3.5)
    found = detector(Finder(*cells), most_fruit=2).find(COLOUR, K)
    assert [fruit.box[0] / FINDER_STRIDE for fruit in found if fruit.box is not None] == (
        pytest.approx([11.5, 7.5])
    )
    assert found[0].score > found[1].score


def at(x: float, score: float, size: float = 20.0) -> FoundFruit:
    return FoundFruit(
        np.array([0.0, 0.0, 0.5]), np.array([0.0, -1.0, 0.0]), np.array([x, 40.0]), size,
        np.ones(3), score, 1.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("finds", "kept"),
    [
        ([at(40.0, 0.5), at(46.9, 0.9)], [0.9]),  # 7 px of 20 px: 0.35
        ([at(40.0, 0.5), at(47.1, 0.9)], [0.9, 0.5]),
        ([at(40.0, 0.5, 40.0), at(53.9, 0.9)], [0.9]),  # the larger one counts
        ([at(40.0, 0.5, 40.0), at(54.1, 0.9)], [0.9, 0.5]),
        ([at(40.0, 0.9), at(46.0, 0.5), at(52.0, 0.4)], [0.9, 0.4]),  # beside one that is not kept
        ([], []),
    ],
)
def test_two_finds_of_one_fruit_are_the_surer_one(
    finds: list[FoundFruit], kept: list[float]
) -> None:
    made = detector(apart=0.35)
    made.judge = lambda _colour, _found, _kind: finds
    assert [fruit.score for fruit in made.find(COLOUR, K)] == kept


def test_the_judge_is_told_the_picture_the_finds_and_the_kind() -> None:
    told: list[Any] = []
    made = detector(Finder((5, 9, 4.0)), kind="apple")

    def judge(colour: Any, found: list[FoundFruit], kind: str) -> list[FoundFruit]:
        told.append((colour is COLOUR, len(found), kind))
        return []

    made.judge = judge
    assert made.find(COLOUR, K) == []
    assert told == [(True, 1, "apple")]


def test_other_options_leave_the_detector_as_it_is() -> None:
    made = detector()
    other = made.looking(replace(OPTIONS, looks=5))
    assert (other.options.looks, made.options.looks) == (5, 1)


def test_warming_up_searches_an_empty_picture_and_takes_one_look() -> None:
    finder, close = Finder(), CloseLook()
    detector(finder, close, working_width=64).warm_up(64, 48)
    assert [made.shape for made in finder.inputs] == [
        (1, 3, 48 + -48 % FINDER_MULTIPLE, 64 + -64 % FINDER_MULTIPLE)
    ]
    assert close.batches == [1]


@pytest.mark.parametrize(
    ("shape", "kind", "fits"),
    [
        ((LEAST_SIDE, LEAST_SIDE, 3), np.uint8, True),
        ((LEAST_SIDE - 1, LEAST_SIDE, 3), np.uint8, False),
        ((LEAST_SIDE, LEAST_SIDE - 1, 3), np.uint8, False),
        ((LEAST_SIDE, LEAST_SIDE, 4), np.uint8, False),
        ((LEAST_SIDE, LEAST_SIDE), np.uint8, False),
        ((LEAST_SIDE, LEAST_SIDE, 3), np.float32, False),
    ],
)
def test_a_picture_is_rgb_of_bytes_and_not_too_small(
    shape: tuple[int, ...], kind: type, fits: bool
) -> None:
    if fits:
        check_picture(np.zeros(shape, kind))
        return
    with pytest.raises(BadFrame, match="at least 32 px on each side"):
        check_picture(np.zeros(shape, kind))


def test_what_is_no_array_is_no_picture() -> None:
    with pytest.raises(BadFrame, match="a list"):
        check_picture([[0]])
    made = detector()
    for call in (
        lambda: made.find(COLOUR[:, :, 0], K),
        lambda: made.looking(replace(OPTIONS, working_width=None)).find(COLOUR[:, :, 0], K),
    ):
        with pytest.raises(BadFrame):
            call()


def test_at_all_widths_each_place_gets_one_look_and_one_box() -> None:
    close = CloseLook()
    made = detector(Finder((5, 9, 4.0), reach=4.0), close, working_width=None)
    picture = np.full((480, 640, 3), 90, np.uint8)
    found = made.find(picture, K)
    assert found
    assert close.batches == [len(made._look_at_all_widths(picture, K))] * 2
    for fruit in found:
        assert 0.0 < fruit.score < 1.0
        assert fruit.box is not None
        assert fruit.box[2:].min() >= 32.0


@pytest.mark.parametrize("side", [128, 256])
def test_places_at_a_width_are_in_pixels_of_the_picture(side: int) -> None:
    picture = np.full((192, 256, 3), 90, np.uint8)
    (place,) = detector(Finder((5, 9, 4.0), reach=4.0)).places_at(picture, side, 0.1)
    middle = 256 / side * np.array([9.5, 5.5]) * FINDER_STRIDE
    assert place.box[:2] + 0.5 * place.box[2:] == pytest.approx(middle)
    assert place.box[2:] == pytest.approx([256 / side * 32.0] * 2)
    assert detector(Finder((5, 9, 4.0), reach=0.2)).places_at(picture, side, 0.1) == []
