"""The compact detector with its shipped weights, from a rendered picture to poses."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from scipy.stats import chi2

from pomona.skills.perception.detection.close_look import OUTLINE_RADIUS, STEM_AXIS
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.detection import DetectorOptions
from pomona.skills.perception.detection.errors import BadFrame
from pomona.skills.perception.detection.instances import FoundFruit, Instance, find_instances
from pomona.skills.perception.detection.places import iou
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.skills.perception.fruit.catalogue import SHIPPED_WEIGHTS
from pomona.tools.pytorch.networks import CloseLookNetwork, FinderNetwork
from pomona.tools.training.annotations import AnnotatedObject, Annotation
from pomona.tools.training.dataset import annotate
from pomona.tools.training.evaluation import Evaluation, evaluate, pair
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.scene import render_scene
from pomona.tools.training.torch_engine import torch_detector

pytestmark = pytest.mark.slow

SEED = 31_000_000
"""Seeds of these frames: neither trained, validated nor benchmarked on."""


K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])


class Rendered:
    """Held-out frames of tables, rendered when asked for."""

    def __init__(self, fruit: FruitModel, count: int) -> None:
        self.options = SceneOptions(kinds=(1, 0, 0, 0))
        self.fruit = fruit
        self.frames = [render_scene(fruit, self.options, SEED + k) for k in range(count)]

    def __len__(self) -> int:
        return len(self.frames)

    def annotation(self, index: int) -> Annotation:
        return annotate(self.frames[index], self.fruit, self.options)

    def picture(self, index: int) -> np.ndarray:
        return self.frames[index].colour


@pytest.fixture(scope="module")
def apple() -> FruitModel:
    return load_fruit("apple")


@pytest.fixture(scope="module")
def detector(apple: FruitModel) -> CompactDetector:
    assert apple.weights is not None
    return CompactDetector.load(apple.weights)


@pytest.fixture(scope="module")
def result(detector: CompactDetector, apple: FruitModel) -> Evaluation:
    return evaluate(detector, Rendered(apple, 16), apple, 16)


@pytest.mark.slow
def test_nearly_all_clearly_visible_apples_are_found(result: Evaluation) -> None:
    assert result.recall(0.5) >= 0.9
    assert result.precision(0.8) >= 0.8


def test_directions_are_within_a_fraction_of_a_degree(result: Evaluation) -> None:
    clear = [m for m in result.matches if m.visibility >= 0.6 and m.score >= 0.6]
    assert np.median([m.direction for m in clear]) < 0.25
    assert np.median([m.axis for m in clear]) < 20.0


def mahalanobis(found: Instance, truth: AnnotatedObject) -> tuple[float, float]:
    """Return the squared distances of the truth from a pose, of its place and of its stem axis.

    The pose is that of a CAD-sized fruit, so the truth is where one would have to be that looks as large.
    """
    T, covariance = found.T_camera_object, found.covariance
    assert T is not None
    assert covariance is not None
    p = truth.T_camera_object[:3, 3]
    distance = float(np.linalg.norm(p))
    touching = np.sqrt(distance**2 - (truth.scale * OUTLINE_RADIUS) ** 2) / truth.scale
    off = p * float(np.hypot(touching, OUTLINE_RADIUS)) / distance - T[:3, 3]
    stem, true_stem = T[:3, :3] @ STEM_AXIS, truth.T_camera_object[:3, :3] @ STEM_AXIS
    turn = np.cross(stem, true_stem)
    turn *= np.arctan2(np.linalg.norm(turn), stem @ true_stem) / np.linalg.norm(turn)
    across = np.linalg.svd(stem[None])[2][1:]
    turn = across @ turn
    return (
        float(off @ np.linalg.solve(covariance[3:, 3:], off)),
        float(turn @ np.linalg.solve(across @ covariance[:3, :3] @ across.T, turn)),
    )


def test_ninety_percent_ellipsoids_of_poses_hold_about_ninety_percent_of_the_truths(
    detector: CompactDetector, apple: FruitModel
) -> None:
    frames, squared = Rendered(apple, 16), list[tuple[float, float]]()
    for index in range(16):
        objects = [one for one in frames.annotation(index).objects if one.visibility > 0.02]
        found = find_instances(detector, frames.picture(index), K, apple)
        pairs, _ = pair(found, objects)
        squared += [
            mahalanobis(found[a], objects[b])
            for a, b in pairs
            if found[a].score >= 0.6 and found[a].covariance is not None
        ]
    assert len(squared) > 40
    for values, freedom in zip(zip(*squared, strict=True), (3, 2), strict=True):
        assert 0.8 < np.mean(np.array(values) <= chi2.ppf(0.9, freedom)) < 0.99


def test_the_same_picture_gives_the_same_poses(
    detector: CompactDetector, apple: FruitModel
) -> None:
    frames = Rendered(apple, 1)
    first, second = (find_instances(detector, frames.picture(0), K, apple) for _ in range(2))
    assert first
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.keypoints, b.keypoints)
        assert a.score == b.score
    assert [i.score for i in first] == sorted((i.score for i in first), reverse=True)


@pytest.mark.parametrize("size", [(480, 640), (720, 1280), (37, 61), (500, 333)])
def test_pictures_of_any_size_are_searched(
    detector: CompactDetector, size: tuple[int, int]
) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    assert all(np.isfinite(found.centre).all() for found in detector.find(noise, K))


@pytest.mark.parametrize("width", [64, 300, 720])
def test_any_working_width_can_be_asked_for(apple: FruitModel, width: int) -> None:
    assert apple.weights is not None
    wide = CompactDetector.load(apple.weights, DetectorOptions(working_width=width))
    picture = np.random.default_rng(1).integers(0, 256, (270, 480, 3), dtype=np.uint8)
    assert wide.maps(picture)[1] == (width, round(270 * width / 480))
    assert all(
        (place.box[:2] + place.box[2:] <= (480.01, 270.01)).all()
        for place in wide.places(picture, 0.0)
    )


def test_pictures_of_another_type_are_refused(detector: CompactDetector) -> None:
    with pytest.raises(BadFrame, match="float64"):
        detector.find(np.full((480, 640, 3), np.nan), K)  # type: ignore[arg-type]


def is_whole(fruit: FoundFruit, picture: np.ndarray) -> bool:
    """Return True if no border cuts the fruit: the first look at a cut one is aimed at its visible part."""
    assert fruit.box is not None
    low, high = fruit.box[:2], fruit.box[:2] + fruit.box[2:]
    return bool((low > 4.0).all() and (high < np.array(picture.shape[1::-1]) - 4.0).all())


@pytest.mark.parametrize(("looks", "mirrored"), [(1, False), (1, True), (3, False)])
def test_any_number_of_looks_finds_the_same_fruit(
    detector: CompactDetector, apple: FruitModel, looks: int, mirrored: bool
) -> None:
    assert apple.weights is not None
    other = CompactDetector.load(apple.weights, DetectorOptions(looks=looks, mirrored=mirrored))
    picture = Rendered(apple, 1).picture(0)
    usual = [
        fruit
        for fruit in detector.find(picture, K)
        if fruit.score >= 0.7 and is_whole(fruit, picture)
    ]
    assert usual
    for fruit in usual:
        nearest = min(
            other.find(picture, K), key=lambda o: float(np.linalg.norm(o.centre - fruit.centre))
        )
        assert np.linalg.norm(nearest.centre - fruit.centre) < 0.1 * fruit.size
        assert nearest.size == pytest.approx(fruit.size, rel=0.1)


def test_a_mirrored_picture_gives_mirrored_fruit(apple: FruitModel) -> None:
    assert apple.weights is not None
    detector = CompactDetector.load(
        apple.weights, DetectorOptions(looks=1, mirrored=True, working_width=640)
    )
    picture = Rendered(apple, 1).picture(0)
    centred = K.copy()
    centred[0, 2] = 0.5 * (picture.shape[1] - 1)
    clearest = next(fruit for fruit in detector.find(picture, centred) if is_whole(fruit, picture))
    (u, v), size = clearest.centre, clearest.size
    (straight,), kinds = detector._look(picture, centred, [(np.array([u, v]), size)], True)
    flipped = np.ascontiguousarray(picture[:, ::-1])
    (mirrored,), mirrored_kinds = detector._look(
        flipped, centred, [(np.array([639.0 - u, v]), size)], True
    )
    assert mirrored.centre == pytest.approx(
        np.array([639.0, 0.0]) + (-1.0, 1.0) * straight.centre, abs=0.5
    )
    assert mirrored.stem == pytest.approx(straight.stem * (-1.0, 1.0, 1.0), abs=0.1)
    assert mirrored_kinds == pytest.approx(kinds, abs=0.3)


def test_untrained_networks_return_in_bounded_time_and_finite() -> None:
    torch.manual_seed(0)
    wild = torch_detector(FinderNetwork(), CloseLookNetwork())
    noise = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    found = wild.find(noise, K)
    assert len(found) <= wild.options.most_fruit
    assert all(np.isfinite([f.size, f.score, f.visibility]).all() for f in found)


def test_evaluation_distinguishes_found_missed_and_wrong() -> None:
    T = np.eye(4)
    T[2, 3] = 0.5
    points = np.vstack(
        [np.array([[x, y] for x in (80.0, 120.0) for y in (80.0, 120.0)] * 2), [[100.0, 100.0]]]
    )
    truth = AnnotatedObject("apple", 0.9, T, points, 1.0, np.ones(3), (80, 80, 40, 40))
    other = replace(truth, visibility=0.7, keypoints=points + 300.0)
    fruit = load_fruit("apple")

    class Fixed:
        def find(self, colour: np.ndarray, K: np.ndarray) -> list[object]:
            return []

    class One:
        def __len__(self) -> int:
            return 1

        def annotation(self, index: int) -> Annotation:
            return Annotation(640, 480, (600.0, 600.0, 320.0, 240.0), (truth, other))

        def picture(self, index: int) -> np.ndarray:
            return np.zeros((480, 640, 3), np.uint8)

    nothing = evaluate(Fixed(), One(), fruit, 1)  # type: ignore[arg-type]
    assert (nothing.recall(0.0), nothing.precision(0.0)) == (0.0, 0.0)
    assert len(nothing.fruit) == 2


@pytest.fixture(scope="module")
def every_width() -> CompactDetector:
    options = DetectorOptions(working_width=None)
    return CompactDetector.load(SHIPPED_WEIGHTS / "apple_photographs.weights", options)


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.3])
def test_the_same_apples_are_found_however_large_the_picture_is(
    every_width: CompactDetector, apple: FruitModel, factor: float
) -> None:
    picture = Rendered(apple, 1).picture(0)
    wanted = [
        fruit
        for fruit in every_width.find(picture, K)
        if fruit.score >= 0.8 and is_whole(fruit, picture)
    ]
    assert wanted
    size = round(factor * 640), round(factor * 480)
    other = np.asarray(
        cv2.resize(picture, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC)
    )
    scaled = K * np.array([[factor], [factor], [1.0]])
    found = every_width.find(other, scaled)
    for fruit in wanted:
        assert fruit.box is not None
        overlaps = iou(
            fruit.box[None] * factor, np.array([one.box for one in found if one.score >= 0.5])
        )
        assert overlaps.max() > 0.6
    assert [one.score for one in found] == sorted((one.score for one in found), reverse=True)


def test_a_picture_smaller_than_the_finders_cells_is_refused_at_all_widths(
    every_width: CompactDetector,
) -> None:
    with pytest.raises(BadFrame, match="at least 32 px"):
        every_width.find(np.zeros((20, 20, 3), np.uint8), K)


def test_the_largest_widths_are_searched_only_where_a_smaller_one_was_sure(
    every_width: CompactDetector, apple: FruitModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    search = CompactDetector.places_at
    monkeypatch.setattr(
        CompactDetector,
        "places_at",
        lambda self, c, side, least: asked.append(side) or search(self, c, side, least),
    )
    assert every_width.find(np.full((100, 3000, 3), 90, np.uint8), K) == []
    assert max(asked) == 1792
    asked.clear()
    picture = np.full((600, 3000, 3), 90, np.uint8)
    picture[:480, :640] = Rendered(apple, 1).picture(0)
    assert every_width.find(picture, K)
    assert max(asked) == 3000


def test_a_picture_without_fruit_gives_none_at_all_widths(every_width: CompactDetector) -> None:
    assert every_width.find(np.full((40, 700, 3), 90, np.uint8), K) == []
