"""Forces of the pads between two ticks, and force control while the ticks stay away.

A paused run does not tick its skills, and a stalled process is late. A speed of the fingers that was commanded before
would go on until the gripper's watchdog ends it, and the force of a grip would stay at any value. The sensor's stream
runs on in both cases: it then steps the force control.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from threading import RLock

import numpy as np

from pomona.drivers import ForceSensor, WrenchSample
from pomona.executive import Float64

PERIOD = 0.02
"""Of the force control without ticks [s]: that of the ticks."""
LATE = 0.03
"""Time without a tick after which the stream steps the force control [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class MeanWrench:
    """Mean of some samples, without the offset."""

    wrenches: Float64  # as in `WrenchSample`, shape (2, 6)
    saturated: bool  # whether a pad was at the end of its range in any of them
    duration: float  # that the samples span [s]

    @property
    def press(self) -> float:
        """Force of the pad that presses more [N]."""
        return float(-self.wrenches[:, 2].min())


class FeltPads:
    """Collects the samples of a sensor for a skill's ticks; `lock` keeps ticks and stream apart."""

    def __init__(self, sensor: ForceSensor) -> None:
        self.lock = RLock()
        self._rate, self._offset = sensor.rate, np.zeros((2, 6))
        self._samples: list[WrenchSample] = []
        self._stand: Callable[[MeanWrench], None] | None = None
        self._paused: Callable[[], bool] = lambda: False
        self._now: Callable[[], float] = lambda: 0.0
        self._ticked = 0.0
        self._subscription = sensor.subscribe(self._on_sample)

    def close(self) -> None:
        """End the subscription: no force control any more. Harmless when closed already."""
        with self.lock:
            self._stand = None
        self._subscription.close()

    def tare(self, largest: float) -> bool:
        """Take the mean of the samples so far as the offset, unless it is larger [N]; False without any sample."""
        felt = self._mean()
        if felt is not None and np.linalg.norm(felt.wrenches[:, :3], axis=1).max() < largest:
            self._offset = self._offset + felt.wrenches
        return felt is not None

    def take(self) -> MeanWrench | None:
        """Return the mean of the samples since the last call, None without any. The ticks come now."""
        self._ticked = self._now()
        return self._mean()

    def between_ticks(
        self,
        stand: Callable[[MeanWrench], None],
        paused: Callable[[], bool],
        now: Callable[[], float],
    ) -> None:
        """Call `stand` every 20 ms in the sensor's loop while the run is paused, or a tick is late.

        Args:
            stand: commands the fingers from the forces.
            paused: whether the motion that the ticks command is paused.
            now: the cell's clock [s].
        """
        with self.lock:
            self._stand, self._paused, self._now, self._ticked = stand, paused, now, now()

    def _mean(self) -> MeanWrench | None:
        with self.lock:
            samples, self._samples = self._samples, []
        if not samples:
            return None
        mean: Float64 = np.mean([sample.wrenches for sample in samples], axis=0) - self._offset
        return MeanWrench(
            mean, any(any(sample.saturated) for sample in samples), len(samples) / self._rate
        )

    def _on_sample(self, sample: WrenchSample) -> None:
        with self.lock:
            self._samples.append(sample)
            if self._stand is None or len(self._samples) < PERIOD * self._rate - 0.5:
                return
            if self._paused() or self._now() - self._ticked > LATE:
                felt = self._mean()
                if felt is not None:
                    self._stand(felt)
