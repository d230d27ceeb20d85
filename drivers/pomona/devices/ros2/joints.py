"""The newest positions of some joints from a topic of `sensor_msgs/JointState`, and how old they are.

Messages of other joints on the same topic are ignored. Old, repeated, future or unreadable messages are dropped:
without valid ones the joints are lost, and the reason describes the dropped ones.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pomona.drivers import DeviceLost
from pomona.executive import Clock, Float64
from pomona.tools.ros2.types import typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
KEPT = 16  # messages that wait to be read; of a flood, only the newest
LARGEST = 65536  # longest message that is read [bytes]: a joint takes some 60, a megabyte longer than a step


class RosNode(Protocol):
    """The part of a node that a device needs: `pomona.tools.ros2.peer.Ros2Peer`."""

    def subscribe(self, topic: str, kind: str, take: Callable[[bytes], None]) -> Any:
        """Call `take` with every message's bytes, in the wire's thread."""

    def publish(self, topic: str, kind: str, coded: Any, stamp: int) -> None:
        """Send bytes; never waits."""

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True, eq=False)
class JointSample:
    """Positions [rad or m] and velocities, shape (n,), in our order; `qd` is None where one of them is missing."""

    stamp: float
    q: Float64
    qd: Float64 | None


class JointFeed:
    """Listens to one topic.

    Attributes:
        went_back: the newest message carries an earlier stamp than one before: its sender's clock was stepped back.
    """

    def __init__(
        self,
        device: str,
        wire: RosNode,
        topic: str,
        joints: Sequence[str],
        clock: Clock,
        silence: float,
        host_time: Callable[[], float] = time.time,
    ) -> None:
        """
        Args:
            joints: their names, in the order that is wanted.
            clock: the cell's; stamps refer to it.
            silence: time without a new sample after which the joints are lost [s].
            host_time: with which the topic's stamps are compared [s since 1970].
        """
        self._device, self._topic, self._joints, self._silence = (
            device,
            topic,
            tuple(joints),
            silence,
        )
        self._clock = clock
        self._host_time = host_time
        self._arrived = threading.Condition()
        self._raw: deque[bytes] = deque(maxlen=KEPT)
        # nanoseconds since 1970; seconds of the cell's clock
        self._last_taken = -1
        self._last_stamp = -np.inf
        self._believed_at = clock.now()
        self._instead = ""
        self.went_back = False
        wire.subscribe(topic, JOINT_STATE, self._take)

    def _take(self, raw: bytes) -> None:
        """In the wire's thread: kept as it is."""
        if len(raw) > LARGEST:
            self._instead = f"has {len(raw)} bytes, more than {LARGEST}"
            return
        with self._arrived:
            self._raw.append(raw)
            self._arrived.notify_all()

    def newest(self, timeout: float = 0.0) -> JointSample | None:
        """Return the newest sample that came since the last call, waiting at most `timeout` [s]; None when none did."""
        with self._arrived:
            self._arrived.wait_for(lambda: bool(self._raw), timeout)
            waiting = list(self._raw)
            self._raw.clear()
        for raw in reversed(waiting):
            sample = self._sample(raw)
            if sample is not None:
                self._believed_at = self._clock.now()
                self._instead = ""
                return sample
        return None

    @property
    def silent_for(self) -> float:
        """Seconds since a sample was taken over."""
        return self._clock.now() - self._believed_at

    def check(self) -> None:
        """Look whether samples come. Raises DeviceLost: none came for too long that could be used."""
        if self.silent_for > self._silence:
            instead = f": the newest message {self._instead}" if self._instead else ""
            raise DeviceLost(
                self._device,
                f"no joints on {self._topic} for {1e3 * self.silent_for:.0f} ms{instead}",
            )

    def _sample(self, raw: bytes) -> JointSample | None:
        try:
            message = typestore().deserialize_cdr(raw, JOINT_STATE)
            places = {name: k for k, name in enumerate(message.name)}
        except Exception:  # any malformed message
            self._instead = f"is no {JOINT_STATE}"
            return None
        missing = [name for name in self._joints if name not in places]
        if missing:
            self._instead = self._instead or f"has no joint {', '.join(missing)}"
            return None
        at = [places[name] for name in self._joints]
        if len(message.position) != len(message.name):
            self._instead = f"has {len(message.position)} positions for {len(message.name)} joints"
            return None
        taken = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        age = self._host_time() - taken / 1e9
        self.went_back = taken < self._last_taken
        if (
            not -0.02 <= age <= self._silence
        ):  # stamps ahead of this machine's clock by more than this are wrong [s]
            self._instead = (
                f"was taken {age:.3g} s ago" if age > 0.0 else f"is of the future, by {-age:.3g} s"
            )
            return None
        if taken <= self._last_taken:
            self._instead = "is not new"
            return None
        self._last_taken = taken
        self._last_stamp = max(
            self._clock.now() - age, self._last_stamp
        )  # two clocks are read one after the other
        rates = (
            np.array(message.velocity, float)[at]
            if len(message.velocity) == len(message.name)
            else None
        )
        if rates is not None and not np.isfinite(rates).all():
            rates = None  # NaN: joint_state_broadcaster, for a joint without an interface of its velocity
        return JointSample(self._last_stamp, np.array(message.position, float)[at], rates)


def stamped(host_time: float) -> Mapping[str, int]:
    """builtin_interfaces/Time of seconds since 1970."""
    seconds, nanoseconds = divmod(round(host_time * 1e9), 10**9)
    return {"sec": seconds, "nanosec": nanoseconds}
