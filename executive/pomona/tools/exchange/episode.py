"""A record as an episode for learning: observations and actions at equal steps of time.

Each value is the newest measurement at that time, without interpolation.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.errors import UsageError
from pomona.executive.recording.digest import Digest, trusted
from pomona.executive.recording.folder import DEVICES, events_file
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.recording.scan import scan
from pomona.executive.recording.well_known import DEPTH, IMAGES
from pomona.executive.values.arrays import Float64
from pomona.executive.values.image_bytes import size_of_image

_Samples = tuple[Float64, Float64]  # times (n,) [s of the run's clock], values (n, m)
_Look = tuple[float, bytes, bytes]  # time [s of the run's clock], JPEG, 16-bit PNG [mm]


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

    Raises UsageError: the record cannot be read or is damaged, or it lacks joints or openings.
    """
    run = trusted(record)
    try:
        return _Taken(record).episode(run, rate)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise UsageError(f"{record}: not a record of a run: {error!r}") from error


class _Taken:
    def __init__(self, record: Path) -> None:
        self._record = record
        self._last = 0.0
        self._devices: dict[str, list[tuple[float, Mapping[str, Any]]]] = {}
        self._looks: list[_Look] = []
        waiting: dict[str, bytes] = {}
        for found in scan(events_file(record)):
            self._last = found.stamp / 1e9
            if found.topic.startswith(DEVICES):
                name = found.topic.removeprefix(DEVICES)
                self._devices.setdefault(name, []).append((self._last, parse_object(found.content)))
            elif found.topic.startswith(IMAGES):
                waiting[found.topic.removeprefix(IMAGES)] = _image(found.content)
            elif found.topic.startswith(DEPTH):
                colour = waiting.pop(found.topic.removeprefix(DEPTH), None)
                if colour is not None:  # a picture without depth was drawn, not taken
                    self._looks.append((self._last, colour, _image(found.content)))

    def episode(self, run: Digest, rate: float) -> Episode:
        state, state_names = self._columns(_joint)
        wrench, wrench_names = self._columns(_force)
        if not state:
            raise UsageError(
                f"{self._record}: it holds no joints, so nothing can be learned from it"
            )
        looks = self._looks_of_one_size()
        seen = np.array([t for t, _colour, _depth in looks])
        start = max([t[0] for t, _values in (*state, *wrench)] + [*seen[:1]])
        count = int((self._last - start) * rate + 1e-9) + 1
        if self._last < start or count < 2:
            raise UsageError(f"{self._record}: it ends before each device has delivered data")
        times = start + np.arange(count) / rate
        at = _newest(seen, times)
        return Episode(
            name=run.run,
            tree=run.tree,
            succeeded=run.outcome == "success",
            times=times,
            state=_sampled(state, times),
            state_names=state_names,
            wrench=_sampled(wrench, times) if wrench else None,
            wrench_names=wrench_names,
            colour=(at, [colour for _t, colour, _depth in looks]) if looks else None,
            depth=(at, [depth for _t, _colour, depth in looks]) if looks else None,
            size=_size(looks[0][1]) if looks else None,
        )

    def _columns(
        self, named: Callable[[str, str], str | None]
    ) -> tuple[list[_Samples], tuple[str, ...]]:
        """Return the samples of each device's quantities that `named` gives a name, and the names."""
        found: list[_Samples] = []
        names: list[str] = []
        for device, messages in self._devices.items():
            chosen = {key: name for key in messages[0][1] if (name := named(device, key))}
            if chosen:
                times = np.concatenate([_times(at, content) for at, content in messages])
                columns = [
                    np.concatenate([_samples(content, key) for _at, content in messages])
                    for key in chosen
                ]
                found.append((times, np.column_stack(columns)))
                names += chosen.values()
        return found, tuple(names)

    def _looks_of_one_size(self) -> list[_Look]:
        """Return the looks of the size that the first has: all images of a dataset are alike."""
        if not self._looks:
            return []
        size = _size(self._looks[0][1])
        return [look for look in self._looks if _size(look[1]) == size == _size(look[2])]


def _image(content: bytes) -> bytes:
    return base64.b64decode(parse_object(content)["data"])


def _size(coded: bytes) -> tuple[int, int]:
    width, height = size_of_image(coded)
    return width, height


def _joint(device: str, quantity: str) -> str | None:
    if quantity.startswith("q_"):
        return f"{device}_joint_{quantity[2:-4]}"
    return f"{device}_width" if quantity == "width_m" else None


def _force(device: str, quantity: str) -> str | None:
    measured = "_force_" in quantity or "_torque_" in quantity
    return f"{device}_{quantity}" if measured else None


def _samples(content: Mapping[str, Any], key: str) -> Float64:
    return np.atleast_1d(np.asarray(content[key], float))


def _times(at: float, content: Mapping[str, Any]) -> Float64:
    """Of a message's samples on the run's clock: the newest was taken when it was written."""
    stamps = _samples(content, "stamp_s")
    times: Float64 = at - (stamps[-1] - stamps)
    return times


def _newest(t: Float64, times: Float64) -> NDArray[np.int64]:
    """Return indices of the newest samples at `times`; -1 before the first."""
    # seconds within which two times are one: a stamp in a record has six decimals
    found: NDArray[np.int64] = np.searchsorted(t, times + 1e-6, side="right") - 1
    return found


def _sampled(channels: list[_Samples], times: Float64) -> Float64:
    return np.concatenate([values[_newest(t, times)] for t, values in channels], axis=1)
