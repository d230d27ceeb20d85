"""A drawn depth image of a fruit on a belt: to compile the tracking before a run, and for its tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.applications.conveyor.conveyor import Belt
from pomona.applications.conveyor.tracks import BeltFrame, Tracks
from pomona.drivers import SIMULATED, Frame, Intrinsics
from pomona.executive import Float64
from pomona.skills import inverse, transform
from pomona.skills.perception import DepthLook, Detection, FruitModel

LENS = Intrinsics(
    305.3, 305.3, 158.6, 118.8, 320, 240
)  # a D435i's depth image with half of its pixels each way
HIGH = 0.45  # height of the camera over the belt [m]
UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Orientation of a fruit that stands, its y axis down."""


def camera_over(belt: Belt, along: float) -> Float64:
    """T_base_camera, (4, 4), of a camera that looks straight down onto a belt [m]."""
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = [along, 0.0, HIGH]
    T_base_camera: Float64 = belt.T_base_belt @ T
    return T_base_camera


def draw(
    model: FruitModel,
    belt: Belt,
    T_base_camera: Float64,
    places: Sequence[Float64],
    t: float,
    n: int,
) -> Frame:
    """Draw fruit of the model's size that stands on a belt.

    Args:
        places: of the fruit's middles in the belt's frame, shape (3,) each [m].
        t, n: stamp [s] and number of the frame.
    """
    top = -inverse(T_base_camera)[:3, :3] @ belt.T_base_belt[:3, 2]
    to_belt = float((T_base_camera[:3, 3] - belt.T_base_belt[:3, 3]) @ belt.T_base_belt[:3, 2])
    v, u = np.mgrid[0 : LENS.height, 0 : LENS.width]
    rays = np.stack([(u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones(u.shape)], axis=-1)
    depth = (to_belt / np.maximum(rays @ top, 1e-3)).astype(np.float32)
    look = DepthLook(depth, LENS, SIMULATED, renderer="zbuffer")
    for place in places:
        virtual, box = look.render(model, inverse(T_base_camera) @ standing(belt, place))
        part = depth[box.slices]
        part[virtual > 0.0] = np.minimum(part, virtual)[virtual > 0.0]
    colour = np.zeros((LENS.height, LENS.width, 3), np.uint8)
    return Frame(t, n, colour, depth, LENS, None, T_base_camera, "drawn", SIMULATED)


def standing(belt: Belt, place: Float64) -> Float64:
    """T_base_fruit, (4, 4), of a fruit that stands at a place of the belt's frame, shape (3,) [m]."""
    T_base_fruit: Float64 = belt.T_base_belt @ transform(UPRIGHT, place)
    return T_base_fruit


def detected(model: FruitModel, belt: Belt, frame: Frame, place: Float64) -> Detection:
    """Return the detection of a drawn fruit, without error."""
    T_base_camera = frame.T_mount_camera
    T_camera_object = inverse(T_base_camera) @ standing(belt, place)
    x, y, z = T_camera_object[:3, 3]
    pixel = np.array([LENS.fx * x / z + LENS.cx, LENS.fy * y / z + LENS.cy])
    covariance = np.diag([0.01, 0.01, 0.01, 1e-4, 1e-4, 1e-4])
    return Detection(
        model, frame, T_base_camera, T_camera_object, np.tile(pixel, (9, 1)), 0.9, covariance, 0, 1
    )


def warm_up(model: FruitModel, belt: Belt) -> None:
    """Compile the loops of tracking, by a first measurement and a fit of a drawn fruit."""
    T_base_camera = camera_over(belt, 0.0)
    place = np.array([0.0, 0.0, float(model.dimensions[1]) / 2.0])
    tracks = Tracks(model, belt, encoder=False)
    for n in range(2):
        frame = draw(model, belt, T_base_camera, [place], n / 30.0, n)
        tracks = tracks.look(
            BeltFrame(frame, T_base_camera, 0.0),
            lambda seen: [detected(model, belt, seen, place)] if seen else [],
        )
