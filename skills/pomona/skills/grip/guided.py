"""Guided pushes: the fingers press in steps, the operator pulls and twists the fruit until it slides."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pomona.drivers.interfaces import ForceSensor, Gripper, HandTask
from pomona.skills.grip.calibration import Push, PushRecorder
from pomona.skills.grip.errors import GuidanceEnded
from pomona.skills.grip.stream_guard import STALE_AFTER

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
        self._gripper, self._sensor = gripper, sensor
        self._now, self._wait, self._tell, self._ask = now, wait, tell, ask

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
            raise GuidanceEnded(f"fingers: no valid sample for {1e3 * STALE_AFTER:.0f} ms; they stand still")
