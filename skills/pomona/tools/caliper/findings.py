"""Sentences about an estimate: how far the camera is off, and the directions that no pick has shown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.directions import (
    FINGERS,
    KNOWN_SCALE,
    KNOWN_ZERO,
    Direction,
    angle_directions,
    further_picks,
    place_directions,
)
from pomona.tools.caliper.estimate import CameraErrors, estimate
from pomona.tools.caliper.notice import is_off
from pomona.tools.caliper.pick import Pick

LIMIT_PLACE = 2e-3
LIMIT_ANGLE = float(np.radians(0.3))
"""Error along one direction up to which a camera sits where the cell file has it [m], [rad]: the fingers give way."""
SURE = 2.5  # standard deviations from which an error is reported along one direction; the odds exclude chance
LEAST_SHOWN = 3  # picks without which nothing is proven
NEWEST = range(3, 9)  # counts of the newest picks that are judged alone
MOVED = 30.0  # squared distance of two poses, in deviations of all six, that chance reaches once in 25 000
PROVEN = 8e-3  # largest error of a fruit's place, two deviations included, that fingers with 8 mm of room allow [m]
REACH = 0.15  # distance of picked fruit from the centre of the picks, for which a turn counts [m]
# part of a direction along one axis: it is that axis, it has a share of it
STRAIGHT = 0.94
PART = 0.34

WAYS = (("right", "left"), ("bottom", "top"), ("far side", "near side"))
"""Directions in the picture: along the camera's axes, and against them."""
LINES = ("across the picture", "along the picture's height", "along the view")
TURNS = ("the picture's horizontal", "the picture's vertical", "the view")


@dataclass(frozen=True, slots=True)
class CameraFinding:
    """How far the camera is off."""

    is_off: bool  # True: farther than chance and the tolerance of a good cell explain
    sentence: str
    far: float = 0.0  # how far fruit lie beside the place that the camera gives, along the shown directions [m]
    moved: bool = False  # the newest picks alone show it


def find_error(found: CameraErrors) -> CameraFinding:
    """Compare the errors with chance, and describe them along the directions that picks have shown.

    The newest picks are judged alone as well: a camera may have been knocked, and the older picks do not show that.
    """
    parts = [found.picks[-count:] for count in NEWEST if count < len(found.picks)]
    off = _off_by(found) or next(filter(None, (_off_by(estimate(p), True) for p in parts)), None)
    if off is not None:
        return off
    number = _number(found)
    places = place_directions(found)
    known = [direction for direction in places if direction.is_known]
    if not known:
        return CameraFinding(
            False, f"The camera's place is not known from {number}{_turned(found)}."
        )
    most = 1e3 * max(direction.value + 2.0 * direction.std for direction in known)
    if len(known) < len(places):
        lines = " and ".join(_line(direction.axis) for direction in known)
        words = f"The camera is at most {most:.1f} mm off {lines} ({number}); along other lines its place is not known."
        return CameraFinding(False, words)
    if most > 1e3 * LIMIT_PLACE:
        return CameraFinding(False, f"The camera is at most {most:.1f} mm off ({number}).")
    return CameraFinding(
        False, f"The camera sits where the cell file has it, within {most:.1f} mm ({number})."
    )


def _off_by(found: CameraErrors, newest: bool = False) -> CameraFinding | None:
    """Return the finding that a camera is off; None where chance or the tolerance of a good cell explains the picks."""
    shifts = [d for d in place_directions(found) if d.value > max(LIMIT_PLACE, SURE * d.std)]
    turns = [d for d in angle_directions(found) if d.value > max(LIMIT_ANGLE, SURE * d.std)]
    if not (shifts or turns) or not is_off(found.used, found.scatter):
        return None
    far = float(
        np.hypot(
            np.linalg.norm([d.value for d in shifts]),
            REACH * np.linalg.norm([d.value for d in turns]),
        )
    )
    number = f"{'the newest ' if newest else ''}{_number(found)}"
    words = f"{_off(shifts, turns, number)}. Directions are those of its picture."
    return CameraFinding(True, words, far, newest)


def is_shown(found: CameraErrors) -> bool:
    """Return True where an error is shown: its interval along some direction leaves zero out."""
    directions = (*place_directions(found), *angle_directions(found))
    return any(direction.value > SURE * direction.std for direction in directions)


def has_moved(picks: Sequence[Pick]) -> bool:
    """Return True where later picks show another pose of the camera than the earlier ones: it was knocked."""
    for count in range(LEAST_SHOWN, len(picks) - LEAST_SHOWN + 1):
        early = estimate(picks[:count])
        late = estimate(picks[count:])
        by = (late.error - early.error)[:6]
        if float(by @ np.linalg.solve((early.covariance + late.covariance)[:6, :6], by)) > MOVED:
            return True
    return False


def _turned(found: CameraErrors) -> str:
    """Describe how well the camera is turned, along the directions that looks at the table have shown."""
    shown = [turn for turn in angle_directions(found) if turn.is_known]
    if not shown:
        return ""
    most = np.degrees(max(turn.value + 2.0 * turn.std for turn in shown))
    about = " and ".join(_turn(turn.axis) for turn in shown)
    if most > np.degrees(LIMIT_ANGLE):
        return f", nor its turn about {about} ({most:.1f}° at most)"
    return f"; it is turned as the cell file has it, within {most:.1f}° about {about}"


def is_proven(found: CameraErrors) -> bool:
    """Return True when fruit lie where the camera puts them, along every level line."""
    touched = [pick for pick in found.used if pick.side and not pick.landed]
    if len(touched) < LEAST_SHOWN:
        return False
    shift, covariance = found.shift
    level = np.linalg.svd(np.mean([pick.up for pick in touched], axis=0)[None])[2][1:]  # (2, 3)
    farthest = np.sqrt(np.linalg.eigvalsh(level @ covariance @ level.T)[-1])
    return float(np.linalg.norm(level @ shift) + 2.0 * farthest) <= PROVEN


def known(found: CameraErrors) -> Iterator[str]:
    """Yield a phrase for each direction that the picks have shown, with its deviation."""
    for place in place_directions(found):
        if place.is_known:
            yield f"place {_line(place.axis)} ± {1e3 * place.std:.1f} mm"
    for angle in angle_directions(found):
        if angle.is_known:
            yield f"turn about {_turn(angle.axis)} ± {np.degrees(angle.std):.2f}°"
    if found.std[6] <= KNOWN_SCALE:
        yield f"scale of the depth ± {1e2 * found.std[6]:.2f} %"
    if found.std[7] <= KNOWN_ZERO:
        yield f"difference of felt and measured widths ± {1e3 * found.std[7]:.2f} mm"


def hidden(found: CameraErrors) -> Iterator[str]:
    """Yield a sentence for each direction that the picks have not shown, with the picks that would."""
    felt = any(pick.side for pick in found.used)
    for place in place_directions(found):
        if not place.is_known:
            picks = further_picks(place.axis, found.used)
            yield f"not known: place {_line(place.axis)} (± {1e3 * place.std:.1f} mm); {picks} would show it"
    for angle in angle_directions(found):
        if not angle.is_known:
            about_view = abs(angle.axis[2]) > max(abs(angle.axis[:2]))
            picks = "looks at fruit from distances that differ by 0.2 m and more"
            if about_view:
                borders = "fruit at the borders of the picture, with fingers that close along these borders,"
                picks = borders if felt else FINGERS
            yield f"not known: turn about {_turn(angle.axis)} (± {np.degrees(angle.std):.1f}°); {picks} would show it"
    sizes = f"{'fruit of sizes that differ by 20 mm and more' if felt else FINGERS} would show it"
    if found.std[6] > KNOWN_SCALE:
        yield f"not known: scale of the depth (± {1e2 * found.std[6]:.1f} %); {sizes}"
    if found.std[7] > KNOWN_ZERO:
        yield f"not known: difference of felt and measured widths (± {1e3 * found.std[7]:.1f} mm); {sizes}"


def next_picks(found: CameraErrors) -> str:
    """Return a sentence with the picks that would show the unknown directions of the place; empty without one."""
    unknown = [place for place in place_directions(found) if not place.is_known]
    if not unknown:
        return ""
    lines = " and ".join(_line(place.axis) for place in unknown)
    picks = " and ".join(dict.fromkeys(further_picks(place.axis, found.used) for place in unknown))
    return f"Its place {lines} is not known within 1 mm: {picks} would show it."


def _off(shifts: Sequence[Direction], turns: Sequence[Direction], number: str) -> str:
    words = []
    if shifts:
        terms = (
            f"{1e3 * d.value:.1f} ± {1e3 * d.std:.1f} mm to the {_towards(d.axis)}" for d in shifts
        )
        words.append(
            f"sits {' and '.join(terms)} of where the cell file has it, or looks as far beside it"
        )
    if turns:
        angles = (
            f"{np.degrees(d.value):.1f} ± {np.degrees(d.std):.1f}° about {_turn(d.axis)}"
            for d in turns
        )
        words.append(f"is turned by {' and '.join(angles)}")
    return f"The camera {', and '.join(words)} ({number})"


def _number(found: CameraErrors) -> str:
    looks = sum(pick.is_look for pick in found.used)
    counts = {"pick": len(found.used) - looks, "look": looks}
    return " and ".join(
        f"{count} {word}{'' if count == 1 else 's'}" for word, count in counts.items() if count
    )


def _towards(axis: Float64) -> str:
    ways = [WAYS[i][int(axis[i] < 0.0)] for i in np.argsort(-np.abs(axis)) if abs(axis[i]) > PART]
    return ways[0] if np.abs(axis).max() > STRAIGHT else " and ".join(ways)


def _line(axis: Float64) -> str:
    best = int(np.argmax(np.abs(axis)))
    return LINES[best] if abs(axis[best]) > STRAIGHT else f"towards the {_towards(axis)}"


def _turn(axis: Float64) -> str:
    best = int(np.argmax(np.abs(axis)))
    return TURNS[best] if abs(axis[best]) > STRAIGHT else f"a line towards the {_towards(axis)}"


def corrected(found: CameraErrors, T_mount_camera: Float64, *, with_depth: bool = False) -> Float64:
    """Return the camera's pose in its mount with the error taken out, shape (4, 4).

    Args:
        T_mount_camera: the pose of the picks, shape (4, 4).
        with_depth: the depth's scale is corrected as well; else the pose takes its error at the centre of the picks.
    """
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(found.error[3:6]).as_matrix()
    T[:3, 3] = found.error[:3] + (0.0 if with_depth else found.error[6]) * found.centre
    pose: Float64 = T_mount_camera @ T
    return pose
