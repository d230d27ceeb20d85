"""Pushes from a person at a cell: the fingers press in steps, the person pulls and twists the fruit until it slides."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pomona.drivers.interfaces import ForceSensor, Gripper, HandTask
from pomona.skills.grip.calibration import Push, PushRecorder
from pomona.skills.grip.errors import GuidanceEnded
from pomona.skills.grip.stream_guard import STALE_AFTER

SQUEEZE_SPEED = 0.004
"""Rate at which the opening closes on the fruit [m/s]."""

NEAR_SPEED = 0.02
"""The same before anything touches [m/s]."""

TOUCH = 0.3
"""Grasp force of fingers that touch [N]."""

LOOK = 0.02
"""Seconds between two looks at the force; the gripper's watchdog wants a speed this often."""

WAYS = (
    ("pull it along the fingers", HandTask.PULL),
    ("twist it about the line between the pads while you pull", HandTask.TWIST),
)

CLOSEST = 0.0005
BIAS_WITHIN = 2.0


class GuidedPushes:
    """Leads a person through pushes. The fingers only ever close or stand until the person asks for the fruit.

    Args:
        gripper, sensor: of the cell.
        now: the cell's clock [s].
        wait: lets so many seconds pass.
        tell: a sentence for the person; ask: a sentence and what it asks for, and waits until the person is ready.
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
        self._gripper, self._sensor = gripper, sensor
        self._now, self._wait, self._tell, self._ask = now, wait, tell, ask

    def record(self, forces: Sequence[float], seconds: float) -> tuple[list[Push], Push]:
        """Take the bias, squeeze, and record a straight and a twisting push at each grasp force.

        Args:
            forces: grasp forces, rising [N].
            seconds: that a person has for one push.

        Returns:
            The pushes, and the squeeze up to the first force.

        Raises:
            GuidanceEnded: the stream stands still, or nothing is between the fingers.
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
                    self._ask(f"At {force:g} N: {way}, slowly, until it slides. You have {seconds:g} s from now.", task)
                    start = recorder.received
                    self._stand(recorder, seconds)
                    pushes.append(recorder.push(start))
        finally:
            subscription.close()
            self._gripper.set_speed(0.0)
        self._ask("Hold the fruit: the fingers open by 10 mm now.", HandTask.LEAVE)
        width = min(self._gripper.state().width + 0.010, self._gripper.limits.width_max)
        motion = self._gripper.move(width, min(NEAR_SPEED, self._gripper.limits.speed_max))
        for _ in range(round(2.0 / LOOK)):
            if motion.settled:
                break
            self._wait(LOOK)
        return pushes, squeeze

    def _wait_for_bias(self, recorder: PushRecorder) -> None:
        began = self._now()
        while not recorder.ready:
            if self._now() - began > BIAS_WITHIN:
                raise GuidanceEnded("the fingers deliver no samples: look at their link with `pomona doctor`")
            self._wait(LOOK)

    def _press(self, recorder: PushRecorder, force: float) -> None:
        """Close until the grasp force is there."""
        while (f_n := recorder.grasp_force()) < force:
            if self._gripper.state().width <= self._gripper.limits.width_min + CLOSEST:
                raise GuidanceEnded(f"the fingers are closed and feel {f_n:.1f} N: nothing is between them")
            self._look(recorder, -NEAR_SPEED if f_n < TOUCH else -SQUEEZE_SPEED)
        self._look(recorder, 0.0)
        self._tell(f"pressing with {recorder.grasp_force():.1f} N")

    def _stand(self, recorder: PushRecorder, seconds: float) -> None:
        for _ in range(max(round(seconds / LOOK), 1)):
            self._look(recorder, 0.0)

    def _look(self, recorder: PushRecorder, speed: float) -> None:
        self._gripper.set_speed(speed)
        self._wait(LOOK)
        if self._now() - recorder.stamp > STALE_AFTER:
            self._gripper.set_speed(0.0)
            raise GuidanceEnded("the fingers have stopped sending usable samples; they stand still")
