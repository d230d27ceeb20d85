"""`pomona calibrate grip`: friction and stiffness of a grip from guided pushes at a cell.

The fingers press in steps, the operator pulls and twists the fruit until it slides.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pomona.drivers.errors import DriverError
from pomona.drivers.interfaces import ForceSensor, Gripper, Hands, HandTask
from pomona.executive.cell.connect import load_cell
from pomona.executive.errors import UsageError
from pomona.executive.files import find_cell
from pomona.executive.recording.plain_file import refuse_taken
from pomona.executive.values.kinds import Measure
from pomona.executive.values.units import FORCE, TIME
from pomona.skills.grip.grip import GripError
from pomona.skills.grip.sensor import STALE_AFTER
from pomona.tools.grip_calibration.calibration import (
    GuidanceEnded,
    Push,
    PushRecorder,
    calibrate_grip,
    write_calibration,
)

SQUEEZE_SPEED = 0.004  # closing speed on the fruit [m/s]
NEAR_SPEED = 0.02  # closing speed before contact [m/s]
TOUCH = 0.3  # grip force of fingers that touch [N]
CHECK_PERIOD = 0.02  # time between two checks of the force [s]; the gripper's watchdog needs a speed this often

WAYS = (
    ("pull it along the fingers", HandTask.PULL),
    ("twist it about the line between the pads while you pull", HandTask.TWIST),
)

CLOSEST = 0.0005  # distance to the gripper's smallest opening at which the fingers are closed [m]
BIAS_WITHIN = 2.0  # longest time for the samples of the bias [s]


class GuidedPushes:
    """Leads the operator through pushes. The fingers only close or stand until the operator asks for the fruit.

    Args:
        gripper, sensor: of the cell.
        now: the cell's clock [s].
        wait: waits for a time [s].
        tell: shows a sentence to the operator.
        ask: shows a sentence and its task, and waits until the operator is ready.
    """

    def __init__(
        self,
        gripper: Gripper,
        sensor: ForceSensor,
        now: Callable[[], float],
        wait: Callable[[float], None],
        tell: Callable[[str], None],
        ask: Callable[[str, HandTask], None],
    ) -> None:
        self._gripper = gripper
        self._sensor = sensor
        self._now = now
        self._wait = wait
        self._tell = tell
        self._ask = ask

    def record(self, forces: Sequence[float], seconds: float) -> tuple[list[Push], Push]:
        """Take the bias, squeeze, and record a straight and a twisting push at each grasp force.

        Args:
            forces: grasp forces, rising [N].
            seconds: time for one push.

        Returns:
            The pushes, and the squeeze up to the first force.

        Raises GuidanceEnded: the stream is stale, or nothing is between the fingers.
        """
        self._ask("Take everything off the fingers and leave them alone.", HandTask.LEAVE)
        recorder = PushRecorder(lambda: self._gripper.state().width)
        subscription = self._sensor.subscribe(recorder.on_sample)
        try:
            self._wait_for_bias(recorder)
            self._ask("Hold the fruit between the fingers. They close slowly.", HandTask.HOLD)
            start = recorder.received
            self._press(recorder, forces[0])
            squeeze = recorder.push(start)
            pushes = []
            for force in forces:
                self._press(recorder, force)
                for way, task in WAYS:
                    self._ask(
                        f"At {force:g} N: {way}, slowly, until it slides. You have {seconds:g} s from now.",
                        task,
                    )
                    start = recorder.received
                    self._stand(recorder, seconds)
                    pushes.append(recorder.push(start))
        finally:
            subscription.close()
            self._gripper.set_speed(0.0)
        self._ask("Hold the fruit: the fingers open by 10 mm now.", HandTask.LEAVE)
        width = min(self._gripper.state().width + 0.010, self._gripper.limits.width_max)
        motion = self._gripper.move(width, min(NEAR_SPEED, self._gripper.limits.speed_max))
        for _ in range(round(2.0 / CHECK_PERIOD)):
            if motion.settled:
                break
            self._wait(CHECK_PERIOD)
        return pushes, squeeze

    def _wait_for_bias(self, recorder: PushRecorder) -> None:
        began = self._now()
        while not recorder.ready:
            if self._now() - began > BIAS_WITHIN:
                raise GuidanceEnded(
                    f"fingers: no samples within {BIAS_WITHIN:g} s; check their link with `pomona doctor`"
                )
            self._wait(CHECK_PERIOD)

    def _press(self, recorder: PushRecorder, force: float) -> None:
        """Close until a grip force is reached [N]."""
        while (f_n := recorder.grasp_force()) < force:
            if self._gripper.state().width <= self._gripper.limits.width_min + CLOSEST:
                raise GuidanceEnded(
                    f"fingers: closed with {max(f_n, 0.0):.1f} N, {force:g} N expected; put the fruit between them"
                )
            self._check(recorder, -NEAR_SPEED if f_n < TOUCH else -SQUEEZE_SPEED)
        self._check(recorder, 0.0)
        self._tell(f"pressing with {recorder.grasp_force():.1f} N")

    def _stand(self, recorder: PushRecorder, seconds: float) -> None:
        for _ in range(max(round(seconds / CHECK_PERIOD), 1)):
            self._check(recorder, 0.0)

    def _check(self, recorder: PushRecorder, speed: float) -> None:
        self._gripper.set_speed(speed)
        self._wait(CHECK_PERIOD)
        if self._now() - recorder.stamp > STALE_AFTER:
            self._gripper.set_speed(0.0)
            raise GuidanceEnded(
                f"fingers: no valid sample for {1e3 * STALE_AFTER:.0f} ms; they stand still"
            )


GRASP_FORCE = Measure(FORCE, "0.6 N", "15 N")  # at which pushes may be made


def add(kinds: Any) -> None:
    """Register `grip` among the kinds of `pomona calibrate`."""
    grip = kinds.add_parser(
        "grip", help="estimate friction and stiffness of a grip from guided pushes"
    )
    grip.add_argument("--cell", required=True, help="cell file, or the name of an installed cell")
    grip.add_argument("--out", type=Path, required=True, help="the parameter file to write")
    grip.add_argument("--fruit", default="", help="name of the fruit, for the report")
    about = "grasp forces (2N 4N 7N)"
    grip.add_argument(
        "--forces",
        type=GRASP_FORCE.option,
        nargs="+",
        default=[2.0, 4.0, 7.0],
        metavar="FORCE",
        help=about,
    )
    long = Measure(TIME, "100 ms", "2 min")
    grip.add_argument("--time", type=long.option, default=6.0, help="time for one push (6s)")
    grip.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Calibrate. Raises UsageError: the pushes cannot be used, or a file is there already."""
    refuse_taken(options.out)
    try:
        pushes, squeeze = _made_now(options)
        found = calibrate_grip(pushes, squeeze)
        write_calibration(found, options.out, options.fruit)
    except (GripError, DriverError, OSError, ValueError) as error:
        raise UsageError(f"pomona calibrate grip: {error}") from error
    sys.stdout.write(
        f"{found}\nwritten to {options.out}; in the cell file: pads: {{include: {options.out}#pads}}\n"
    )
    return 0


def _made_now(options: argparse.Namespace) -> tuple[list[Push], Push]:
    forces = sorted(options.forces)
    with contextlib.closing(_cell(options.cell)) as cell:
        clock = cell.clock
        wait = clock.advance if clock.simulated else time.sleep
        try:
            gripper = cell.device(Gripper)
            sensor = cell.device(ForceSensor)
        except KeyError as missing:
            raise GuidanceEnded(str(missing.args[0])) from missing
        guide = GuidedPushes(gripper, sensor, clock.now, wait, _tell, _who_is_asked(cell))
        return guide.record(forces, options.time)


def _cell(name: str) -> Any:
    """Connect a cell by its file or the name of an installed one."""
    return load_cell(find_cell(name))


def _tell(sentence: str) -> None:
    sys.stdout.write(f"{sentence}\n")
    sys.stdout.flush()


def _who_is_asked(cell: Any) -> Callable[[str, HandTask], None]:
    """Return a function that asks the hands of a simulated cell if it has some, else the operator at the terminal."""
    if Hands not in cell.interfaces():
        return _ask
    hands = cell.device(Hands)

    def ask(sentence: str, task: HandTask) -> None:
        _tell(f"{sentence} [simulated hands]")
        hands.do(task)

    return ask


def _ask(sentence: str, task: HandTask) -> None:
    try:
        input(f"{sentence} [Enter] ")
    except EOFError:
        raise GuidanceEnded("an operator must read the instructions and press Enter") from None
