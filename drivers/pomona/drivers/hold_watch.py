"""State of the hand: contact between the fingers, by force, width and motor, and the memory that outlives a connection.

Fingers that measure from a bias must not take it under load: the load would read as zero. So the last bias is kept with
the last state of the hand, and a driver of such fingers asks `HandMemory` before it takes a new one. A killed process
cannot write, so each change is written when it happens.

`may_hold` decides it before the fingers are calibrated; `HoldWatch` follows it while a cell is connected, keeps it for
the next connection, and compares arm and grip after a pause. Where no finger measures a force, width and motor decide:
`pomona.drivers.plain_hand` has the evidence of an object, and a hand whose state is unknown may hold something.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from pomona.drivers.errors import DeviceError, DeviceFault
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, GripperLimits, GripperState
from pomona.drivers.plain_hand import (
    GIVE,
    MOTOR_FORCE,
    NO_ROOM,
    SHORT,
    between,
    gone,
    has_room,
    presses,
    short,
)
from pomona.executive.values.arrays import Float64
from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.processes import warn

logger = logging.getLogger(__name__)

FORMAT = "pomona hand 1"


@dataclass(frozen=True, slots=True)
class HandRecord:
    """Last known state of a hand."""

    held: str = ""  # sentence about the held object; empty for an empty hand
    # opening between the pads at that time [m]; None for any opening (the hand of a new simulated world)
    width: float | None = None
    # voltages without contact [V] by the fingerprint of a finger's calibration
    bias: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    opens_to: float | None = None  # where empty fingers were opening to [m]: they grip nothing


class HandMemory:
    """Keeps the newest `HandRecord` of one hand, in a file or in this process alone. Callable from any thread."""

    def __init__(self, path: Path | None, record: HandRecord | None = None) -> None:
        """
        Args:
            path: of the file; None keeps the record in this process.
            record: the first one; by default the file's.
        """
        self.path = path
        self._lock = threading.Lock()
        self._record = record if record is not None or path is None else _read(path)
        self._warned = False

    @property
    def record(self) -> HandRecord | None:
        """The newest record; None when nothing is known."""
        return self._record

    def keep_bias(self, bias: Mapping[str, tuple[float, ...]], width: float | None) -> None:
        """Keep a bias that was just taken, with an empty hand at this width [m]."""
        self._keep(lambda _last: HandRecord("", width, bias))

    def keep_hand(self, held: str, width: float, opens_to: float | None = None) -> None:
        """Keep the state of the hand at this width, from which empty fingers may be opening [m]."""
        self._keep(lambda last: replace(last, held=held, width=width, opens_to=opens_to))

    def _keep(self, change: Callable[[HandRecord], HandRecord]) -> None:
        """A file that cannot be written is removed and reported once: the next connection then knows nothing."""
        with self._lock:
            self._record = change(self._record or HandRecord())
            try:
                if self.path is not None:
                    _write(self.path, self._record)
            except OSError as error:
                if not self._warned:
                    warn(logger, "%s: the state of the hand cannot be kept: %s", self.path, error)
                self._warned = True


def memory_of(wires: Iterable[str]) -> HandMemory:
    """Return the memory of the hand on these wires: a file of the user's state folder."""
    base = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    key = hashlib.sha256("\n".join(sorted(wires)).encode()).hexdigest()[:16]
    return HandMemory(Path(base, "pomona", f"hand-{key}.json"))


def _read(path: Path) -> HandRecord | None:
    """A damaged file is no record: nothing is known then."""
    try:
        content = json.loads(read_plain_text(path))
        if content["format"] != FORMAT:
            return None
        width = float(content["width"])
        opens_to = content.get("opens_to")
        opens_to = None if opens_to is None else float(opens_to)
        bias = {
            str(key): tuple(float(volts) for volts in taxels)
            for key, taxels in content["bias"].items()
        }
        finite = math.isfinite(width + (opens_to or 0.0)) and all(
            math.isfinite(volts) for taxels in bias.values() for volts in taxels
        )
        return HandRecord(str(content["held"]), width, bias, opens_to) if finite else None
    except (OSError, ValueError, RecursionError, TypeError, KeyError, AttributeError):
        return None


def _write(path: Path, record: HandRecord) -> None:
    """Replace the file as a whole; when that fails, remove it: an outdated record could call a full hand empty."""
    new = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new.write_text(json.dumps({"format": FORMAT, **asdict(record)}), encoding="utf-8")
        new.replace(path)
    except OSError:
        for outdated in (path, new):
            outdated.unlink(missing_ok=True)
        raise


MOVED = 0.01  # change of a joint while paused from which the arm counts as moved from outside [rad]
# grasp force of a finger at the pause that holds, and below which it is lost [N]
HELD_FORCE = 0.5
LOST_FORCE = 0.2
STOOD = 1e-3  # change of the width below which the fingers have not been moved [m]; an encoder repeats to 0.1 mm
SLOW = 2e-3  # fingers slower than this rest [m/s], as for a gripper's supervisor
SURE = "something is between the fingers"
HARDLY = f"the grip force fell below {LOST_FORCE:g} N: the fruit may have been lost"
LOOSE = "the gripper's motor presses no more: the fruit may have been lost"


def may_hold(
    state: GripperState, limits: GripperLimits, last: HandRecord | None, force: float | None
) -> str:
    """Return why something may be between fingers at rest; empty when nothing can be.

    `last` is the last known state of the hand, `force` the smaller pressing force from the last known bias [N]; None if
    unknown.
    """
    if not state.referenced:
        return "the gripper has no reference, so its opening is unknown"
    if state.motor_force is not None and state.motor_force > MOTOR_FORCE:
        return f"the gripper's motor presses with {state.motor_force:.1f} N"
    if not has_room(state.width, limits):
        return ""
    if force is not None and force > HELD_FORCE:
        return f"each finger presses with {force:.1f} N or more, measured from the last bias"
    here = f"the fingers stand at {1e3 * state.width:.1f} mm"
    if last is None:
        return f"{here}, and the last state of the hand is unknown"
    if (
        not last.held
        and last.width is not None
        and last.opens_to is not None
        and last.width - STOOD <= state.width <= last.opens_to + STOOD
    ):
        return ""
    if last.width is not None and not abs(state.width - last.width) <= (
        GIVE if last.held else STOOD
    ):
        return f"{here}, and stood at {1e3 * last.width:.1f} mm when the hand was last known"
    return f"{here}, where they may hold something" if last.held else ""


class HoldWatch:
    """Follows the state of the hand, notes arm and grip at rest, and compares before motion goes on."""

    def __init__(
        self,
        arm: Arm | None,
        fingers: ForceSensor | None,
        gripper: Gripper | None,
        memory: HandMemory | None = None,
    ) -> None:
        """
        Args:
            memory: state of the hand before this connection; kept up to date.
        """
        self._arm = arm
        self._fingers = fingers
        self._gripper = gripper
        self._memory = memory
        self._q: Float64 | None = None
        self._force: float | None = None
        self._hand = ""
        self._unfelt = HARDLY
        self._held_at: float | None = None
        self._begun = False
        # widest opening since the empty fingers last reached the width of a move [m]
        self._stood = math.inf
        # of a hand without force sensor that holds something
        self._noted: GripperState | None = None

    def forget(self) -> None:
        """Nothing is remembered any more."""
        self._q = self._force = self._noted = None

    def note(self) -> None:
        """Keep the state at rest; later calls change nothing until `forget`."""
        if self._q is None and self._arm is not None:
            self._q = self._arm.state().q.copy()
        if self._force is None:
            self._force = self._least_force()
        if self._force is None and self._noted is None and self.in_hand():
            self._noted = self._state()

    def compare(self) -> None:
        """Compare with the noted state. Raises DeviceFault: the arm was moved, or the fruit is gone."""
        if self._q is not None and self._arm is not None:
            moved = float(np.abs(self._arm.state().q - self._q).max())
            if not moved <= MOVED:  # so that joints that are no number are not as they were
                raise DeviceFault(
                    "arm", f"was moved by {np.degrees(moved):.1f}° while the run was paused"
                )
        force = self._least_force()
        if (
            self._force is not None
            and self._force > HELD_FORCE
            and (force is None or not force >= LOST_FORCE)
        ):
            now = "nothing is felt" if force is None else f"now {force:.1f} N"
            raise DeviceFault(
                "fingers", f"the fruit that was held with {self._force:.1f} N is gone ({now})"
            )
        if self._noted is not None and self._gripper is not None:
            why = gone(self._noted, self._gripper.state(), self._gripper.limits, STOOD)
            if why:
                raise DeviceFault(
                    "gripper", f"{why} while the run was paused: the fruit may be gone"
                )

    def in_hand(self) -> str | None:
        """Describe an object that may be between the fingers: an empty text for none, None in a cell without a hand.

        Force and opening decide together. If the force is below the threshold and the opening is still that of a grip,
        the fingers may hold the fruit: a small force suffices, and a bias may have been taken under load. Without a
        measured force the motor's force and the width of the last move decide.
        """
        force = self._least_force()
        gripper = self._state()
        if force is None and self._gripper is None:
            return None
        if (
            force is None
            and not self._begun
            and (gripper is None or (self._fingers is not None and not self._memory))
        ):
            silent = "gripper" if gripper is None else "force sensor"
            return f"the {silent} has sent nothing yet, so the state of the hand is unknown"
        if gripper is not None and not self._begun:
            self._begin(gripper, force)
        if force is not None:
            self._feel(force, None if gripper is None else gripper.width)
        elif gripper is not None:
            self._infer(gripper)
        if gripper is not None:
            self._keep(gripper)
        return self._hand

    def _feel(self, force: float, width: float | None) -> None:
        """Decide by the smaller force of both fingers [N] and their opening [m]."""
        if force > HELD_FORCE:
            self._hand = SURE
            self._unfelt = HARDLY
            self._held_at = width
        elif force < LOST_FORCE and self._hand:
            away = width is None or self._held_at is None or abs(width - self._held_at) > GIVE
            self._hand = "" if away else self._unfelt

    def _infer(self, state: GripperState) -> None:
        """Decide by the motor's force and the width where no finger measures a force.

        A held object is there until the fingers have let go. Empty fingers at rest may hold something if they were
        stopped before the width of their move, or have closed without one.
        """
        assert self._gripper is not None
        limits = self._gripper.limits
        if self._hand and self._let_go(state, limits):
            self._hand = ""
            self._stood = state.width
        if state.moving or abs(state.speed) > SLOW or not state.referenced:
            return
        evidence = between(state, limits)
        if (
            not evidence
            and state.aim is None
            and state.width < self._stood - SHORT
            and has_room(state.width, limits)
        ):
            evidence = f"the fingers closed to {1e3 * state.width:.1f} mm, and no move ended there"
        if evidence and (presses(state) or not self._hand):
            self._hand = SURE if presses(state) else evidence
            self._held_at = state.width
        elif self._hand == SURE:
            self._hand = LOOSE
        elif not self._hand:
            self._stood = state.width if state.aim is not None else max(state.width, self._stood)

    def _let_go(self, state: GripperState, limits: GripperLimits) -> bool:
        """Return True if fingers that held something are closed, have opened, or have closed to the width of a move.

        A motor that does not report its force may press at that width.
        """
        if state.width <= limits.width_min + NO_ROOM:
            return True
        if presses(state) or self._held_at is None:
            return False
        aim = None if state.motor_force is None else state.aim
        reached = aim is not None and abs(state.width - aim) <= short(limits)
        return state.width - self._held_at > GIVE or (
            reached and self._held_at - state.width > GIVE
        )

    def _begin(self, gripper: GripperState, force: float | None) -> None:
        """Continue from the state of the hand before this connection."""
        self._begun = True
        self._stood = gripper.width
        if self._gripper is None or (self._memory is None and force is not None):
            return
        last = None if self._memory is None else self._memory.record
        why = may_hold(gripper, self._gripper.limits, last, force)
        if why:
            self._hand = self._unfelt = f"something may be between the fingers: {why}"
            there = (
                last is not None
                and last.width is not None
                and abs(gripper.width - last.width) <= GIVE
            )
            known = last is not None and last.held and (force is not None or there)
            self._held_at = last.width if last is not None and known else gripper.width

    def _keep(self, gripper: GripperState) -> None:
        """Keep a new state of the hand at once, and a new opening as soon as the fingers stand."""
        if self._memory is None or not math.isfinite(gripper.width):
            return
        last = self._memory.record
        same = last is not None and last.held == self._hand
        stood = (
            same
            and last is not None
            and last.width is not None
            and abs(gripper.width - last.width) <= STOOD
        )
        if not same or (not stood and not gripper.moving):
            self._memory.keep_hand(self._hand, gripper.width)
        elif (
            last is not None
            and last.width is not None
            and gripper.aim is not None
            and not self._hand
            and last.width - STOOD <= gripper.width < gripper.aim != last.opens_to
        ):
            self._memory.keep_hand("", last.width, gripper.aim)

    def _state(self) -> GripperState | None:
        """Of the gripper; None when it is lost, or there is none."""
        try:
            return None if self._gripper is None else self._gripper.state()
        except DeviceError:
            return None

    def _least_force(self) -> float | None:
        """Return the smaller of the two fingers' normal forces [N]."""
        sample = self._fingers.latest() if self._fingers is not None else None
        return None if sample is None else float((-sample.wrenches[:, 2]).min())
