"""Fruit over many frames: one identity each."""

from dataclasses import replace

import numpy as np
import pytest

from pomona.applications.inventory.book import FruitBook
from pomona.applications.inventory.sighting import Sighting, sighting_of
from pomona.skills.geometry import rot_z, transform
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.fruit.catalogue import mass_model, mass_of
from tests.skills.applications.inventory.test_tabulate import found
from tests.skills.picking_scene import apple_at

APPLE = load_fruit("apple")
HERE = np.eye(4)


def seen(x: float, measured: bool = True, width_mm: float = 80.0, number: int = 1) -> Sighting:
    """Return a fruit at (x, 0, 0) m, 80 mm wide by default; an unmeasured one is guessed along the y axis."""
    size, deviation = np.array([width_mm, 70.0, width_mm]) * 1e-3, 2e-3
    place = deviation**2 * np.eye(3) if measured else np.diag([deviation**2, 0.2**2, deviation**2])
    return Sighting(
        "a", number, 0.9, 0.8, np.array([x, 0.0, 0.0]), place, 1.0, APPLE, np.eye(3), size if measured else None,
        deviation**2 * np.eye(3) if measured else None, np.empty((0, 2)), np.zeros(2), 0.9,
        "" if measured else "NO_DEPTH",
    )  # fmt: skip


def test_a_fruit_that_three_frames_show_is_counted_once_and_measured_by_all_of_them() -> None:
    book = FruitBook()
    assert book.add_frame([seen(0.0), seen(0.2)], HERE) == [1, 2]
    assert book.add_frame([seen(0.202), seen(0.001), seen(0.4)], HERE) == [2, 1, 3]
    assert book.add_frame([seen(0.0, width_mm=81.0)], HERE) == [1]
    assert (len(book.fruit), book.scenes) == (3, 1)
    assert [len(fruit.sightings) for fruit in book.fruit] == [3, 2, 1]
    assert book.fruit[0].size.looks == 3
    assert book.fruit[0].size.dimensions[0] == pytest.approx(0.0803, abs=1e-4)


def test_frames_without_camera_poses_are_not_merged() -> None:
    book = FruitBook()
    assert book.add_frame([seen(0.0)], None) == [1]
    assert book.add_frame([seen(0.0)], None) == [2]
    assert (len(book.fruit), book.scenes) == (2, 2)


def test_a_motion_of_the_camera_brings_places_into_one_frame() -> None:
    book, T = FruitBook(), transform(rot_z(0.5), (0.3, -0.1, 0.2))
    book.add_frame([seen(0.0), seen(0.2)], None)
    moved = [s.moved(np.linalg.inv(T)) for s in (seen(0.2), seen(0.0))]
    assert book.add_frame(moved, T) == [2, 1]
    far = transform(None, (0.1, 0.0, 0.0))
    assert book.add_frame([seen(0.0)], far) == [3]
    assert book.add_frame([seen(0.03)], HERE, 0.0) == [1]
    assert book.add_frame([seen(0.06)], HERE, 0.05) == [
        3
    ]  # which of two it is nearer to, when neither is sure


def test_an_unmeasured_fruit_chooses_last_and_is_measured_when_another_frame_shows_it() -> None:
    book = FruitBook()
    assert book.add_frame([seen(0.0, measured=False)], HERE) == [1]
    assert book.fruit[0].size is None
    assert book.fruit[0].why == "NO_DEPTH"
    # both could be the first fruit; that which was measured is
    assert book.add_frame([seen(0.0, measured=False), seen(0.001)], HERE) == [2, 1]
    assert book.fruit[0].why == ""
    assert book.fruit[0].size.looks == 1


def test_the_order_of_sightings_in_a_frame_changes_nothing() -> None:
    sightings = [seen(0.1 * k) for k in range(5)]
    for order in ([0, 1, 2, 3, 4], [4, 2, 0, 3, 1]):
        book = FruitBook()
        book.add_frame(sightings, HERE)
        assert book.add_frame([sightings[k] for k in order], HERE) == [k + 1 for k in order]


def test_a_sighting_is_the_measured_fruit_or_a_guess_as_far_as_its_size_may_differ() -> None:
    apple = apple_at(1, 3, sigma=2e-3)
    detection = replace(
        found(apple), T_camera_object=transform(None, (0.0, 0.0, 1.5)), covariance=1e-6 * np.eye(6)
    )
    measured = sighting_of(detection, apple, "", 4)
    assert measured.number == 4
    assert measured.p_base == pytest.approx(apple.T_base_fruit[:3, 3])
    assert measured.dimensions == pytest.approx([0.089, 0.081, 0.089])
    guess = sighting_of(detection, apple, "NO_DEPTH", 1)
    assert (guess.dimensions, guess.why) == (None, "NO_DEPTH")
    assert np.sqrt(np.diag(guess.place_covariance)) == pytest.approx([1e-3, 1e-3, 0.3], rel=0.01)
    assert sighting_of(detection, None, "", 1).why


def test_mass_goes_with_the_volume_and_errs_with_size_and_kind() -> None:
    dimensions = APPLE.dimensions * 0.8
    mass, deviation = mass_of(APPLE, dimensions, np.zeros((3, 3)))
    assert mass == pytest.approx(0.512 * APPLE.mass)
    assert deviation == pytest.approx(mass * APPLE.mass_spread)
    _, wider = mass_of(APPLE, dimensions, np.diag((0.02 * dimensions) ** 2))
    assert wider == pytest.approx(mass * np.hypot(APPLE.mass_spread, np.sqrt(3.0) * 0.02))
    assert "394 g" in mass_model(APPLE)
    unknown = replace(APPLE, mass=None)
    assert mass_of(unknown, dimensions, np.zeros((3, 3))) is None
    assert mass_model(unknown) == ""
