"""A record as an episode for learning: observations and actions at equal steps of time.

Each value is the newest measurement at that time, without interpolation.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import DEVICES, EVENTS, events_file
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.recording.scan import scan
from pomona.executive.recording.well_known import DEPTH, IMAGES
from pomona.executive.values.arrays import Float64
from pomona.executive.values.image_bytes import size_of_image


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """Samples of one observation: times (n,) [s of the run's clock] and values (n, m), or n coded images."""

    t: Float64
    values: Any

    def at(self, times: Float64) -> NDArray[np.int64]:
        """Return indices of the newest samples at `times` (n,) [s], shape (n,); -1 before the first."""
        # seconds within which two times are one: a stamp in a record has six decimals
        found: NDArray[np.int64] = np.searchsorted(self.t, times + 1e-6, side="right") - 1
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """Observations and actions of one run."""

    name: str  # of the record
    tree: str  # of the run
    succeeded: bool  # how the run ended
    times: Float64  # of the steps, shape (n,) [s of the run's clock], at equal distances
    state: Float64  # joints [rad] and openings [m], shape (n, m); named by `state_names`
    state_names: tuple[str, ...]
    wrench: Float64 | None  # forces [N] and torques [N·m] of the fingers, shape (n, k), or None
    wrench_names: tuple[str, ...]
    # colour, depth: the newest look's JPEG and 16-bit PNG [mm] at each step as indices into a list of files, or None
    colour: tuple[NDArray[np.int64], list[bytes]] | None
    depth: tuple[NDArray[np.int64], list[bytes]] | None
    size: tuple[int, int] | None  # width and height of both [px]

    @property
    def action(self) -> Float64:
        """The actions: the state one step later, in the shape and units of `state`; the last one repeats."""
        return np.concatenate([self.state[1:], self.state[-1:]])


def read_episode(record: Path, rate: float) -> Episode:
    """Return the episode of a record.

    Args:
        record: a record's folder or file.
        rate: steps a second.

    Raises UsageError: the record cannot be read, or lacks joints or openings.
    """
    try:
        return _Taken(record).episode(rate)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise UsageError(f"{record}: not a record of a run: {error!r}") from error


class _Taken:
    def __init__(self, record: Path) -> None:
        self._record = record
        self._about: Mapping[str, Any] = {}
        self._end: Mapping[str, Any] = {}
        self._last = 0.0
        self._devices: dict[str, list[tuple[float, Mapping[str, Any]]]] = {}
        self._with_depth: list[tuple[float, bytes, bytes]] = []
        waiting: dict[str, bytes] = {}
        for found in scan(events_file(record)):
            self._last = found.stamp / 1e9
            if found.topic == EVENTS:
                self._take_event(found.content)
            elif found.topic.startswith(DEVICES):
                name = found.topic.removeprefix(DEVICES)
                self._devices.setdefault(name, []).append((self._last, parse_object(found.content)))
            elif found.topic.startswith(IMAGES):
                waiting[found.topic.removeprefix(IMAGES)] = base64.b64decode(
                    parse_object(found.content)["data"]
                )
            elif found.topic.startswith(DEPTH):
                colour = waiting.pop(found.topic.removeprefix(DEPTH), None)
                if colour is not None:  # a picture without depth was drawn, not taken
                    depth = base64.b64decode(parse_object(found.content)["data"])
                    self._with_depth.append((self._last, colour, depth))

    def _take_event(self, content: bytes) -> None:
        if not self._about or b'"RunEnded"' in content[:40]:
            event = parse_object(content)
            if event["event"] == "RunStarted":
                self._about = event
            elif event["event"] == "RunEnded":
                self._end = event

    def episode(self, rate: float) -> Episode:
        if not self._about:
            raise UsageError(f"{self._record}: not a record of a run")
        state, state_names = self._columns(
            lambda name: name.startswith("q_") or name == "width_m", _joint
        )
        wrench, wrench_names = self._columns(
            lambda name: "_force_" in name or "_torque_" in name, lambda d, n: f"{d}_{n}"
        )
        if not state:
            raise UsageError(
                f"{self._record}: it holds no joints, so nothing can be learned from it"
            )
        looks = self._one_size()
        begins = [channel.t[0] for channel in (*state, *wrench)] + [
            t for t, _colour, _depth in looks[:1]
        ]
        start = max(begins)
        count = int((self._last - start) * rate + 1e-9) + 1
        if self._last < start or count < 2:
            raise UsageError(f"{self._record}: it ends before each device has delivered data")
        times = start + np.arange(count) / rate
        at = Channel(np.array([t for t, _c, _d in looks]), looks).at(times) if looks else None
        return Episode(
            name=self._record.stem if self._record.is_file() else self._record.resolve().name,
            tree=str(self._about["tree"]),
            succeeded=self._end.get("outcome") == "success",
            times=times,
            state=_together(state, times),
            state_names=state_names,
            wrench=_together(wrench, times) if wrench else None,
            wrench_names=wrench_names,
            colour=None if at is None else (at, [colour for _t, colour, _depth in looks]),
            depth=None if at is None else (at, [depth for _t, _colour, depth in looks]),
            size=_size(looks[0][1]) if looks else None,
        )

    def _columns(self, wanted: Any, called: Any) -> tuple[list[Channel], tuple[str, ...]]:
        channels, names = [], []
        for device, messages in self._devices.items():
            chosen = [name for name in messages[0][1] if wanted(name)]
            if chosen:
                t = np.concatenate([_times(at, content) for at, content in messages])
                rows = [
                    np.array([np.atleast_1d(content[name]) for name in chosen], float)
                    for _at, content in messages
                ]
                channels.append(Channel(t, np.concatenate(rows, axis=1).T))
                names += [called(device, name) for name in chosen]
        return channels, tuple(names)

    def _one_size(self) -> list[tuple[float, bytes, bytes]]:
        """Looks of the size that the first has: all images of a dataset are alike."""
        if not self._with_depth:
            return []
        size = _size(self._with_depth[0][1])
        return [look for look in self._with_depth if _size(look[1]) == size == _size(look[2])]


def _size(coded: bytes) -> tuple[int, int]:
    width, height = size_of_image(coded)
    return width, height


def _joint(device: str, name: str) -> str:
    return f"{device}_joint_{name[2:-4]}" if name.startswith("q_") else f"{device}_width"


def _times(at: float, content: Mapping[str, Any]) -> Float64:
    """Of a message's samples on the run's clock: the newest was taken when it was written."""
    stamps: Float64 = np.atleast_1d(np.asarray(content["stamp_s"], float))
    times: Float64 = at - (stamps[-1] - stamps)
    return times


def _together(channels: list[Channel], times: Float64) -> Float64:
    return np.concatenate([channel.values[channel.at(times)] for channel in channels], axis=1)
