"""Synthetic picks with known errors of the calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pomona.tools.caliper.estimate import BIAS, LANDED, PRIOR, SHOWN, SIZE, TOUCH, WIDTH, ZERO
from pomona.tools.caliper.pick import Pick


def made_pick(rng: np.random.Generator, error: np.ndarray, **how: Any) -> Pick:
    """Return the pick of `made_fruit`."""
    return made_fruit(rng, error, **how)[0]


def made_fruit(
    rng: np.random.Generator,
    error: np.ndarray,
    *,
    noise: float = 1.0,
    tilt: float = 0.0,
    plain: bool = False,
    name: str = "",
    azimuth: float | None = None,
    bias: float = 0.0,
) -> tuple[Pick, float]:
    """A pick on a table 0.4 to 0.6 m before a camera that looks down on it, under an error (t, ω, κ, z).

    Returns the pick and the fruit's true width along the fingers [m].

    Args:
        noise: of touches and sizes, over the assumed ones.
        tilt: largest angle between the fingers' axis and the picture's plane [rad].
        azimuth: of the fingers' axis in the picture [rad]; drawn where None.
        bias: of the camera in all sizes, which `error` has in its last number [m].
    """
    place = np.array([*rng.uniform(-0.15, 0.15, 2), rng.uniform(0.4, 0.6)])
    turn = rng.uniform(0.0, 2.0 * np.pi) if azimuth is None else azimuth
    lean = rng.uniform(-tilt, tilt)
    axis = np.array([np.cos(turn) * np.cos(lean), np.sin(turn) * np.cos(lean), np.sin(lean)])
    across = rng.uniform(0.06, 0.095)
    t, omega, kappa, zero = error[:3], error[3:6], error[6], error[7]
    moved = float(axis @ (t + np.cross(omega, place) + kappa * place))
    size = SHOWN * kappa * across + noise * SIZE * rng.normal()
    side = 1 if moved >= 0.0 else -1
    wider = size + zero + noise * WIDTH * rng.normal()
    first = side * moved + 0.5 * (size + zero) + noise * TOUCH * rng.normal()
    if plain:
        side, first, wider = 0, np.nan, np.nan
    pick = Pick(
        name, axis, place, across, side, first, wider, np.eye(4), True, np.array([0.0, 0.0, -1.0])
    )
    return pick, across + size - bias


def drawn_error(rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Draw an error (t, ω, κ, z) by its prior, and the camera's bias in z [m]."""
    error, zero, bias = PRIOR * rng.normal(size=8), ZERO * rng.normal(), BIAS * rng.normal()
    error[7] = zero - bias
    return error, bias


def made_picks(rng: np.random.Generator, error: np.ndarray, count: int, **how: Any) -> list[Pick]:
    """Several such picks."""
    return [made_pick(rng, error, name=f"pick {i}", **how) for i in range(count)]


def looked(
    picks: Sequence[Pick], error: np.ndarray, wrong: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0)
) -> list[Pick]:
    """The same picks with looks at a level table 0.55 m below the camera, under an error of the camera.

    Args:
        wrong: error of the table itself in the cell file: its height [m] and two tilts [rad].
    """
    stated = np.array([wrong[1], wrong[2], -1.0])
    stated = np.append(stated, 0.55 + wrong[0]) / np.linalg.norm(stated)
    turn, down = Rotation.from_rotvec(error[3:6]).as_matrix(), np.array([0.0, 0.0, -1.0])
    normal = (turn + error[6] * np.eye(3)).T @ down  # a seen point q lies at turn q + t + κ q
    seen = np.append(normal, 0.55 + down @ error[:3]) / np.linalg.norm(normal)
    return [replace(pick, table=np.array([seen, stated])) for pick in picks]


def doubted(error: np.ndarray, name: str = "look") -> dict:
    """`DoubtedLook` as a record has it, of a camera with an error that looks down on a level table from 0.55 m."""
    (look,) = looked([made_pick(np.random.default_rng(0), error, name=name)], error)
    assert look.table is not None
    table, T = look.table.tolist(), np.eye(4).tolist()
    return {"type": "DoubtedLook", "table": table, "T_mount_camera": T, "on_arm": True}


def made_landing(
    rng: np.random.Generator, error: np.ndarray, *, noise: float = 1.0, name: str = "landing"
) -> Pick:
    """A finger that lands on a fruit from above, somewhere between its top and its side."""
    down, turn = rng.uniform(0.3, 1.2), rng.uniform(0.0, 2.0 * np.pi)
    axis = np.array([np.cos(turn) * np.sin(down), np.sin(turn) * np.sin(down), -np.cos(down)])
    pick, _ = made_fruit(rng, error, name=name)
    moved = error[:3] + np.cross(error[3:6], pick.place) + error[6] * pick.place
    first = (
        float(axis @ moved) + 0.5 * SHOWN * error[6] * pick.across + noise * LANDED * rng.normal()
    )
    return replace(pick, axis=axis, side=1, first=first, wider=np.nan, landed=True)


def recorded(
    shift: float = 0.0, *, wider: float = 0.0, x: float = 0.0, yaw: float = 0.0, y: float = -0.5
) -> dict:
    """`PickTouches` as a record has it: an 80 mm fruit that lies `shift` [m] towards the left finger."""
    c, s = np.cos(yaw), np.sin(yaw)
    T_base_tcp = np.array(
        [[s, c, 0.0, x], [-c, s, 0.0, y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    )
    T_base_fruit, T_base_camera = np.eye(4), np.eye(4)
    T_base_fruit[:3, 3] = x, y, 0.0
    T_base_camera[:3, :3] = np.diag([1.0, -1.0, -1.0])
    T_base_camera[:3, 3] = 0.0, -0.5, 0.5
    second = 0.08 + wider
    first = second + 2.0 * abs(shift)
    widths = (first, second) if shift >= 0.0 else (second, first)
    left, right = ({"type": "PadTouch", "stamp": 1.0, "width": w, "force": 0.5} for w in widths)
    return {
        "type": "PickTouches",
        "fruit": "apple",
        "left": left,
        "right": right,
        "closed": None,
        "T_base_tcp": T_base_tcp.tolist(),
        "T_base_fruit": T_base_fruit.tolist(),
        "T_base_camera": T_base_camera.tolist(),
        "T_mount_camera": np.eye(4).tolist(),
        "on_arm": True,
        "dimensions": [0.08, 0.075, 0.08],
        "skin": [0.04, 0.04],
    }
