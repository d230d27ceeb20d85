"""Hazards, the nodes that guard against them, their limits, and the largest measured values over many runs.

The hazards are data (trees/hazards), since the executive knows no fruit and no robot. Measurements come only from
records that pass their checks; the others are counted and named.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pomona.executive.errors import UsageError
from pomona.executive.language.expression import UNITS
from pomona.executive.recording.digest import Digest, digest
from pomona.executive.recording.folder import DEVICES, EVENTS, events_file
from pomona.executive.recording.plain_file import open_plain, parse_object
from pomona.executive.recording.scan import scan
from pomona.executive.values.installation import further_checks
from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.sentences import ReportLine

_OF_THE_RUN = ("outcome", "code", "tree", "tree_hash", "cell", "cell_kind", "git")
TAKES = ("largest", "sum", "rate")
_KEYS = ("hazard", "node", "limit", "unit", "saturates", "measure", "meaning")


@dataclass(frozen=True, slots=True)
class Hazard:
    """A hazard."""

    name: str  # its name in reports
    node: str  # the node that guards against it
    unit: str  # unit of its values
    meaning: str  # description of the measurement
    limits: tuple[
        float, ...
    ]  # one number, or one for each quantity; empty if each run's cell has the limit
    limit_in_cell: tuple[
        str, ...
    ]  # dotted keys of the limit in a cell file; the first existing one counts
    limit_in_series: str  # name of the threshold that is recorded with a series
    saturates: bool  # True if a value at the limit counts as beyond it, since the sensor saturates
    measure: Mapping[
        str, str
    ]  # the measurement in a record; the simulated world's truth counts if it is larger


@dataclass(slots=True)
class Measured:
    """The largest value of one hazard."""

    runs: int = 0  # number of runs with a measurement
    # value of the sample nearest to its limit; None without a measurement
    value: float | None = None
    limit: float | None = None  # limit of that sample
    run: str = ""  # run of that sample
    t: float = 0.0  # time of that sample in its run [s]
    quantity: str = ""  # quantity of that sample
    beyond: int = 0  # number of runs beyond the limit

    def take(
        self, run: str, t: float, value: float, limit: float | None, quantity: str, saturates: bool
    ) -> None:
        """Take the largest value of one run."""
        self.runs += 1
        self.beyond += limit is not None and (value > limit or (saturates and value == limit))
        if self.value is None or _share(value, limit) > _share(self.value, self.limit):
            self.value = value
            self.limit = limit
            self.run = run
            self.t = t
            self.quantity = quantity


@dataclass(slots=True)
class Evidence:
    """Measurements of many records."""

    hazards: tuple[Hazard, ...]  # the hazards
    measured: tuple[Measured, ...]  # the largest value of each hazard, in the same order
    # of every record that was read: the SHA-256 of its file, outcome, cell, number of interventions
    runs: list[dict[str, Any]] = field(default_factory=list)
    left_out: dict[str, str] = field(
        default_factory=dict
    )  # reason for every record that was not read
    checks: list[ReportLine] = field(
        default_factory=list
    )  # of all records together, by other packages

    def as_json(self) -> dict[str, Any]:
        """Return the measurements as JSON."""
        rows = [
            {**asdict(h), **asdict(m)} for h, m in zip(self.hazards, self.measured, strict=True)
        ]
        checks = [
            {"check": check.name, "ok": check.ok, "found": check.found} for check in self.checks
        ]
        return {"hazards": rows, "runs": self.runs, "left_out": self.left_out, "checks": checks}


def read_hazards(path: Path) -> tuple[Hazard, ...]:
    """Read a file of hazards. Raises UsageError: it cannot be read, or is malformed."""
    try:
        content = yaml.safe_load(read_plain_text(path))
        return tuple(_hazard(entry) for entry in content["hazards"])
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error
    except (
        yaml.YAMLError,
        RecursionError,
        KeyError,
        TypeError,
        AttributeError,
        ValueError,
        re.error,
    ) as error:
        raise UsageError(f"{path}: not a file of hazards: {error}") from error


def _hazard(entry: Mapping[str, Any]) -> Hazard:
    if unknown := set(entry) - set(_KEYS):
        raise ValueError(
            f"unknown: {', '.join(sorted(map(str, unknown)))}; known: {', '.join(_KEYS)}"
        )
    limit = entry["limit"]
    measure = {str(key): str(value) for key, value in entry["measure"].items()}
    where = limit if isinstance(limit, dict) else {}
    in_cell = tuple(map(str, where.get("cell", ())))
    in_series = str(where.get("series", ""))
    limits = (
        ()
        if where
        else tuple(float(value) for value in (limit if isinstance(limit, list) else [limit]))
    )
    if "device" in measure:
        re.compile(measure["quantities"])
        if measure["take"] not in TAKES:
            raise ValueError(f"take is one of {', '.join(TAKES)}, not '{measure['take']}'")
    elif not {"series", "truth", "success_without", "event"} & measure.keys():
        raise ValueError(
            f"{entry['hazard']}: measure needs device, series, truth, success_without or event"
        )
    words = (
        str(entry["hazard"]),
        str(entry["node"]),
        str(entry.get("unit", "")),
        str(entry.get("meaning", "")),
    )
    return Hazard(*words, limits, in_cell, in_series, bool(entry.get("saturates")), measure)


def _cell(text: str) -> Any:
    """Parse a cell's text. Raises ValueError: it cannot be parsed."""
    try:
        return yaml.safe_load(text) or {}
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(f"its cell cannot be read: {type(error).__name__}") from error


def gather(records: Sequence[Path], hazards: tuple[Hazard, ...]) -> Evidence:
    """Measure every hazard in every valid record."""
    evidence = Evidence(hazards, tuple(Measured() for _ in hazards))
    for record in records:
        try:
            found = digest(record)
            if found.state != "ended" or not found.checked or found.lost:
                evidence.left_out[record.name] = _why_not(found)
                continue
            _measure(record, found, evidence)
        except (
            UsageError,
            OSError,
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
            IndexError,
        ) as error:
            evidence.left_out[record.name] = f"it cannot be measured: {error}"
    evidence.checks += further_checks(
        [record for record in records if record.name not in evidence.left_out]
    )
    return evidence


def _why_not(found: Digest) -> str:
    if found.lost:
        return f"it was damaged and repaired; lost: {found.lost}"
    if found.state == "ended":
        return "it was written without checksums"
    return f"{found.state}: {found.message}"


def _measure(record: Path, found: Digest, evidence: Evidence) -> None:
    path = events_file(record)
    run = _Run(path, {hazard.measure.get("series", "") for hazard in evidence.hazards})
    for hazard, measured in zip(evidence.hazards, evidence.measured, strict=True):
        value = run.largest(hazard, found)
        if value is not None:
            measured.take(record.name, *value, hazard.saturates)
    with open_plain(path) as stream:
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()  # type: ignore[arg-type]
    about = {name: getattr(found, name) for name in _OF_THE_RUN}
    evidence.runs.append(
        {"run": record.name, "sha256": sha256, **about, "interventions": run.interventions}
    )


_Sample = tuple[float, float, float | None, str]  # t, value, limit, quantity


class _Run:
    """Measurements of one record by device, and its series of some topics."""

    def __init__(self, path: Path, topics: Collection[str]) -> None:
        self.cell: Any = {}
        self.interventions = 0
        self._series: dict[str, list[Mapping[str, Any]]] = {}
        self._events: dict[str, list[dict[str, Any]]] = {}
        self._succeeded: set[str] = set()  # types of the nodes that succeeded
        types: dict[str, str] = {}
        columns: dict[str, dict[str, list[Any]]] = {}
        for topic, content, *_ in scan(path):
            if topic.startswith(DEVICES):
                device = columns.setdefault(topic.removeprefix(DEVICES), {})
                for name, values in parse_object(content).items():
                    if isinstance(values, list):
                        device.setdefault(name, []).extend(values)
            elif topic == EVENTS:
                match parse_object(content):
                    case {"event": "RunStarted" | "TickOverran" as name} as event:
                        self._events.setdefault(name, []).append(event)
                        types |= {node["path"]: node["type"] for node in event.get("nodes", ())}
                    case {"event": "NodeChanged", "status": "SUCCESS", "path": str(path_of_node)}:
                        self._succeeded.add(types.get(path_of_node, ""))
                    case {"event": "OperatorActed"}:
                        self.interventions += 1
                    case {
                        "event": "Published",
                        "topic": str(shown),
                        "value": {"type": "SeriesView"} as view,
                    }:
                        if shown in topics:
                            self._series.setdefault(shown, []).append(view)
        for started in self._events.get("RunStarted", ()):
            self.cell = _cell(started["cell_text"])
        self._devices = {
            device: {name: np.array(values, float) for name, values in found.items()}
            for device, found in columns.items()
        }

    def largest(self, hazard: Hazard, found: Digest) -> _Sample | None:
        """Return (t, value, limit, quantity) of the sample nearest to its limit; None without a measurement."""
        measure = hazard.measure
        limits = hazard.limits or self._limits(hazard.limit_in_cell)
        limit = limits[0] if limits else None
        sensed = None
        if "device" in measure:
            sensed = self._of_device(measure, limits)
        elif "series" in measure:
            sensed = self._of_series(measure, hazard.limit_in_series)
            limit = sensed[2] if sensed is not None else None
        value = (found.truth or {}).get(measure.get("truth", ""))
        if value is not None and (sensed is None or float(value) > sensed[1]):
            return found.time or 0.0, float(value), limit, f"truth: {measure['truth']}"
        if sensed is not None or measure.keys() & {"device", "series", "truth"}:
            return sensed
        if "success_without" in measure:
            names = [
                name
                for name in measure["success_without"].split(", ")
                if name in (found.truth or {})
            ]
            if not names or (
                found.outcome == "success" and not self._succeeded & set(hazard.node.split(", "))
            ):
                return None
            achieved = any((found.truth or {})[name] for name in names)
            return found.time or 0.0, float(found.outcome == "success" and not achieved), limit, ""
        if found.cell_kind == measure.get("except_cell"):
            return None
        events = self._events.get(measure["event"], [])
        values = [
            (float(event["t"]), float(event[measure["field"]]), limit, "") for event in events
        ]
        return max(values, key=lambda entry: entry[1], default=(0.0, 0.0, limit, ""))

    def _of_device(self, measure: Mapping[str, str], limits: Sequence[float]) -> _Sample | None:
        device = self._devices.get(measure["device"], {})
        t = device.get("stamp_s")
        names = [name for name in device if re.fullmatch(measure["quantities"], name)]
        if t is None or not names or t.size < 2:
            return None
        start = float(t[0])
        if measure["take"] == "sum":
            total = np.sum([np.abs(device[name]) for name in names], axis=0)
            return _peak(t - start, total, limits[0] if limits else None, "")
        rows = [
            _peak(
                t - start,
                np.abs(_rate(t, device[name]) if measure["take"] == "rate" else device[name]),
                limit,
                name,
            )
            for name, limit in zip(names, _spread(limits, len(names)), strict=True)
        ]
        return _nearest(rows)

    def _of_series(self, measure: Mapping[str, str], threshold: str) -> _Sample | None:
        views = self._series.get(measure["series"], ())
        name = measure["quantity"]
        rows = [
            _peak(
                np.array(view["t"], float),
                np.array(view["values"][name], float),
                view["thresholds"].get(threshold),
                "",
            )
            for view in views
            if view["values"].get(name)
        ]
        return _nearest(rows)

    def _limits(self, keys: Sequence[str]) -> tuple[float, ...]:
        for dotted in keys:
            value = self.cell
            for key in dotted.split("."):
                value = value.get(key) if isinstance(value, dict) else None
            if value is not None:
                return (_si(str(value)),)
        return ()


def _peak(
    t: NDArray[np.float64], values: NDArray[np.float64], limit: float | None, name: str
) -> _Sample | None:
    finite = np.isfinite(values)
    if not finite.any():
        return None
    at = int(np.argmax(np.where(finite, values, -np.inf)))
    return float(t[at]), float(values[at]), limit, name


def _nearest(samples: Iterable[_Sample | None]) -> _Sample | None:
    """Return the sample nearest to its limit, or beyond it."""
    known = (sample for sample in samples if sample is not None)
    return max(known, key=lambda sample: _share(sample[1], sample[2]), default=None)


def _rate(t: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the change per second between samples, shape as `values`; NaN for equal stamps."""
    dt = np.diff(t)
    rate = np.full(t.shape, np.nan)
    moved = dt > 0.0
    rate[1:][moved] = np.diff(values)[moved] / dt[moved]
    return rate


def _spread(limits: Sequence[float], count: int) -> Iterator[float | None]:
    for k in range(count):
        yield limits[k] if k < len(limits) else (limits[-1] if limits else None)


def _share(value: float, limit: float | None) -> float:
    return value if not limit else value / limit


def _si(text: str) -> float:
    """20 N -> 20.0; 200 mm/s -> 0.2."""
    _number, _space, unit = text.strip().partition(" ")
    return float(UNITS[unit][0].parse(text)) if unit in UNITS else float(text)
