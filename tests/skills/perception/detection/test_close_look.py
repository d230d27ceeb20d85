"""The look is a camera turned to a fruit: its pictures and labels agree with the real camera."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.skills.perception.detection.close_look import (
    CENTRE,
    CLOSE_LOOK_SIZE,
    OUTLINE_RADIUS,
    REFERENCE_LENGTH,
    SIZE,
    STEM_AXIS,
    label_rotation,
    look_at,
)

K = np.array([[610.6, 0.0, 317.7], [0.0, 598.0, 238.1], [0.0, 0.0, 1.0]])
PLACE = st.tuples(st.floats(-0.25, 0.25), st.floats(-0.18, 0.18), st.floats(0.3, 0.9))


def in_picture(p: np.ndarray) -> np.ndarray:
    return p[:2] / p[2] * (K[0, 0], K[1, 1]) + K[:2, 2]


@settings(max_examples=100)
@given(
    PLACE,
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
        lambda v: np.linalg.norm(v) > 0.2
    ),
    st.tuples(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.8, 1.25)),
    st.floats(-np.pi, np.pi),
)
def test_a_label_gives_back_the_place_and_the_stem(
    p: tuple[float, ...], stem: tuple[float, ...], aim: tuple[float, ...], roll: float
) -> None:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = label_rotation(stem, p), p
    size = K[0, 0] * REFERENCE_LENGTH / p[2]
    look = look_at(K, in_picture(T[:3, 3]) + aim[:2], size * aim[2], roll)
    p_camera, stem_camera = look.place(look.label(T, 1.0))
    assert np.allclose(p_camera, p, atol=1e-6)
    assert np.allclose(stem_camera, T[:3, :3] @ STEM_AXIS, atol=1e-6)


@settings(max_examples=60)
@given(PLACE, st.floats(0.6, 1.2))
def test_a_fruit_of_another_size_has_the_label_of_the_cad_sized_one_that_looks_the_same(
    p: tuple[float, ...], scale: float
) -> None:
    T, scaled = np.eye(4), np.eye(4)
    T[:3, 3], scaled[:3, 3] = np.array(p), scale * np.array(p)
    look = look_at(K, in_picture(T[:3, 3]), K[0, 0] * REFERENCE_LENGTH / p[2])
    assert np.allclose(look.label(T, 1.0), look.label(scaled, scale), atol=1e-9)


@pytest.mark.parametrize("p", [(0.0, 0.0, 0.5), (0.2, -0.13, 0.5), (-0.12, 0.06, 0.35)])
def test_a_ball_is_round_in_the_look_wherever_it_lies_and_as_large_as_its_label_says(
    p: tuple[float, ...],
) -> None:
    centre, radius = np.array(p), OUTLINE_RADIUS
    v, u = np.mgrid[:480, :640]
    rays = np.stack(
        [(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u, float)], axis=-1
    )
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = rays @ centre
    picture = np.where(centre @ centre - along**2 < radius**2, 255, 0).astype(np.uint8)
    look = look_at(K, in_picture(centre), K[0, 0] * REFERENCE_LENGTH / p[2])
    side = (CLOSE_LOOK_SIZE, CLOSE_LOOK_SIZE)
    view = cv2.warpPerspective(
        picture, look.picture_from_look, side, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    rows, columns = np.nonzero(view > 127)
    T = np.eye(4)
    T[:3, 3] = centre
    label = look.label(T, 1.0)
    width = 2.0 * np.exp(label[SIZE]) * 0.5 * CLOSE_LOOK_SIZE * radius / REFERENCE_LENGTH
    assert np.ptp(columns) + 1 == pytest.approx(width, abs=2.0)
    assert np.ptp(rows) + 1 == pytest.approx(width, abs=2.0)
    middle = 0.5 * (CLOSE_LOOK_SIZE - 1) + 0.5 * CLOSE_LOOK_SIZE * label[CENTRE]
    assert np.allclose([columns.mean(), rows.mean()], middle, atol=0.7)
