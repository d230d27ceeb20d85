"""Fruit from frame to frame: births, losses, crossings, hiding, rolling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pomona.applications.conveyor.conveyor import Belt
from pomona.applications.conveyor.drawn_frame import camera_over, detected, draw
from pomona.applications.conveyor.tracks import BORN, GONE, BeltFrame, Tracks
from pomona.skills.perception import FruitModel, load_fruit

RATE = 30.0
SPEED = 0.2


@pytest.fixture(scope="module")
def apple() -> FruitModel:
    return load_fruit("apple")


@pytest.fixture(scope="module")
def belt() -> Belt:
    T = np.eye(4)
    T[:3, 3] = [0.1, -0.36, -0.12]
    T[:2, :2] = [[0.8, -0.6], [0.6, 0.8]]
    return Belt(T, 1.8, 0.24)


class Film:
    """Drawn frames of apples at places that are functions of time, and their tracks."""

    def __init__(self, model: FruitModel, belt: Belt, encoder: bool = True) -> None:
        self.tracks = Tracks(model, belt, encoder)
        self.model, self.belt = model, belt
        self.T_base_camera, self.n = camera_over(belt, 0.0), 0

    def show(
        self, count: int, *fruit: Callable[[float], tuple[float, float]], hidden: bool = False
    ) -> None:
        for _ in range(count):
            t = self.n / RATE
            middle = float(self.model.dimensions[1]) / 2.0
            places = [np.array([*where(t), middle]) for where in fruit]
            frame = draw(
                self.model, self.belt, self.T_base_camera, () if hidden else places, t, self.n
            )
            searches = self.n % 5 == 0 and not hidden
            find = (
                (lambda seen, at=places: [detected(self.model, self.belt, seen, p) for p in at])
                if searches
                else None
            )
            travelled = SPEED * t if self.tracks.encoder else 0.0
            self.tracks = self.tracks.look(BeltFrame(frame, self.T_base_camera, travelled), find)
            self.n += 1

    @property
    def now(self) -> float:
        return (self.n - 1) / RATE


def carried(x: float, y: float, speed: float = SPEED) -> Callable[[float], tuple[float, float]]:
    return lambda t: (x + speed * t, y)


def test_a_fruit_is_born_once_and_counts_after_some_frames(apple: FruitModel, belt: Belt) -> None:
    film = Film(apple, belt)
    film.show(BORN - 1, carried(-0.1, 0.02))
    assert [(track.number, track.rests) for track in film.tracks.tracks] == [(0, False)]
    film.show(1, carried(-0.1, 0.02))
    assert [(track.number, track.rests) for track in film.tracks.tracks] == [(0, True)]


@pytest.mark.parametrize("encoder", [True, False])
def test_its_place_half_a_second_ahead_is_right_and_its_ellipse_is_honest(
    apple: FruitModel, belt: Belt, encoder: bool
) -> None:
    film = Film(apple, belt, encoder)
    film.show(20, carried(-0.08, -0.03))
    track, t = film.tracks.tracks[0], film.now + 0.5
    place, covariance = film.tracks.expected(track, t, SPEED * t if encoder else 0.0)
    off = place - [-0.08 + SPEED * t, -0.03, apple.dimensions[1] / 2.0]
    assert np.abs(off).max() < 2e-3
    assert off[:2] @ np.linalg.solve(covariance[:2, :2], off[:2]) < 9.2


def test_a_fruit_that_is_not_where_it_should_be_is_gone_after_three_frames(
    apple: FruitModel, belt: Belt
) -> None:
    film = Film(apple, belt)
    film.show(14, carried(-0.1, 0.0))
    film.show(GONE - 1, carried(-0.1, 0.0), hidden=True)
    assert len(film.tracks.tracks) == 1
    film.show(1, carried(-0.1, 0.0), hidden=True)
    assert film.tracks.tracks == ()
    assert film.tracks.track(0) is None


def test_a_fruit_that_is_hidden_for_two_frames_keeps_its_number(
    apple: FruitModel, belt: Belt
) -> None:
    film = Film(apple, belt)
    film.show(12, carried(-0.1, 0.0))
    film.show(GONE - 1, carried(-0.1, 0.0), hidden=True)
    film.show(5, carried(-0.1, 0.0))
    assert [track.number for track in film.tracks.tracks] == [0]
    assert film.tracks.tracks[0].missed == 0


def test_fruit_beside_fruit_keeps_its_number_though_one_rolls_past_the_other(
    apple: FruitModel, belt: Belt
) -> None:
    film = Film(apple, belt)
    rests, rolls = carried(-0.05, 0.055), carried(-0.15, -0.055, SPEED + 0.12)
    film.show(24, rests, rolls)
    by_number = {track.number: track for track in film.tracks.tracks}
    assert set(by_number) == {0, 1}
    beside = {number: track.resting.place[1] for number, track in by_number.items()}
    assert beside[0] == pytest.approx(0.055, abs=2e-3)
    assert beside[1] == pytest.approx(-0.055, abs=2e-3)
    assert by_number[0].rests
    assert not by_number[1].rests


def test_a_belt_that_jumps_ends_the_track_within_three_frames(
    apple: FruitModel, belt: Belt
) -> None:
    film = Film(apple, belt)
    film.show(15, carried(-0.12, 0.0))
    film.show(GONE, lambda t: (-0.12 + SPEED * t + 0.045, 0.0), hidden=False)
    assert all(
        track.number != 0 or track.missed > 0 or not track.rests for track in film.tracks.tracks
    )


def test_a_fruit_out_of_the_picture_is_expected_and_not_missed_until_the_belt_ends(
    apple: FruitModel, belt: Belt
) -> None:
    film = Film(apple, belt)
    film.show(12, carried(-0.02, 0.0))
    track = film.tracks.tracks[0]
    empty = draw(apple, belt, film.T_base_camera, [], 3.0, 90)
    away = film.tracks.look(BeltFrame(empty, film.T_base_camera, SPEED * 3.0), None)
    assert away.tracks[0].missed == 0
    assert away.tracks[0].resting.t == track.resting.t
    gone = film.tracks.look(
        BeltFrame(replace(empty, stamp=6.0), film.T_base_camera, SPEED * 6.0), None
    )
    assert gone.tracks == ()


def test_one_mesh_object_serves_a_track_for_its_whole_life(apple: FruitModel, belt: Belt) -> None:
    """The surface of a mesh is computed once for each object: a copy in each frame would cost twenty times the fit."""
    film = Film(apple, belt)
    film.show(2, carried(-0.1, 0.0))
    mesh = film.tracks.tracks[0].mesh
    film.show(8, carried(-0.1, 0.0))
    assert film.tracks.tracks[0].mesh is mesh
