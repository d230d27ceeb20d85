"""Looks over a cell before a run: its file, ports, every device, rates, intrinsics, calibrations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from pathlib import Path

import numpy as np

from pomona.drivers.errors import CellFileError, DriverError
from pomona.drivers.interfaces import (
    Arm,
    Camera,
    ForceSensor,
    Frame,
    Gripper,
    LoadSensor,
    PressSensor,
    WrenchSample,
    WrenchSensor,
)
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.cell_file import judge_cell_file
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.device import Device
from pomona.executive.recording.folder import records_in
from pomona.executive.values.findings import Findings, place_of
from pomona.executive.values.installation import further_checks
from pomona.executive.values.sentences import ReportLine

WATCHED = 1.0  # duration for which streams are watched [s]
ENOUGH = 0.95  # ratio of the measured rate to the nominal one below which it is reported
FELT = (ForceSensor, PressSensor, LoadSensor)  # interfaces of sensors that stream wrenches
FREE = 0.5  # largest force of a pad that nothing touches [N]
GRAVITY = 9.81  # [m/s²]
OFF_GAUGE = 1.5e-3  # largest error of a reported opening [m]: as the conformance of grippers allows
# rates that a camera and an arm should have at least [Hz]
SLOWEST_CAMERA = 2.0
SLOWEST_ARM = 20.0


def examine(
    path: Path,
    overrides: Mapping[str, str] | None = None,
    records: Path | None = None,
    gauge: float | None = None,
) -> Iterator[ReportLine]:
    """Look over a cell: its file, every device, rates, intrinsics. Nothing moves; servos and streams are switched on.

    Args:
        overrides: values of the file's options.
        records: folder of records; those of this cell show how well it is calibrated.
        gauge: true opening between the pads [m].
    """
    missing: dict[str, DriverError] = {}
    try:
        cell = load_cell(path, overrides=overrides, missing=missing.__setitem__)
    except DriverError as error:
        yield from _refused("cell file", error)
        return
    try:
        yield ReportLine("cell file", True, f"{path} ({cell.kind})")
        doubts = Findings()
        judge_cell_file(path, doubts, overrides)
        for doubt in doubts.sorted():
            if doubt.severity == "warning":
                known = doubt.code == "declared"
                yield ReportLine(
                    "cell file", known, f"{place_of(doubt)}: {doubt.message}", doubt.hint
                )
        for name, refused in missing.items():
            yield from _refused(name, refused)
        rates = _watch(cell)
        for name, device in cell.devices.items():
            yield from _device(name, device, rates.get(name, _Watched()), cell)
            if gauge is not None and Gripper in device.interfaces and isinstance(device, Gripper):
                yield compared_with_gauge(name, device, gauge)
        if records is not None and (found := sorted(path.parent for path in records_in(records))):
            yield from further_checks(found, cell.name)
    finally:
        cell.close()


def _refused(name: str, error: DriverError) -> list[ReportLine]:
    if isinstance(error, CellFileError):
        return [
            ReportLine(name, False, f"{place_of(found)}: {found.message}", found.hint)
            for found in error.findings
        ]
    return [ReportLine(name, False, str(error))]


@dataclass(slots=True)
class _Watched:
    """Data received from a device while it was watched."""

    stamps: int = 0
    gaps: int = 0
    age: float = 0.0


def _watch(cell: Cell) -> dict[str, _Watched]:
    watched = {name: _Watched() for name in cell.devices}
    subscriptions = []
    for name, device in cell.devices.items():
        if isinstance(device, WrenchSensor) and set(FELT) & set(device.interfaces):
            subscriptions.append(device.subscribe(_counter(watched[name])))
    end = cell.clock.now() + WATCHED
    seen: dict[str, float] = {}
    while cell.clock.now() < end:
        cell.clock.advance(0.005)
        now = cell.clock.now()
        for name, device in cell.devices.items():
            stamp = _newest_stamp(device)
            if stamp is not None and stamp != seen.get(name):
                seen[name] = stamp
                watched[name].stamps += 1
                watched[name].age = max(watched[name].age, now - stamp)
    for subscription in subscriptions:
        subscription.close()
    return watched


def _counter(watched: _Watched) -> Callable[[WrenchSample], None]:
    last: list[int] = []

    def count(sample: WrenchSample) -> None:
        if last and sample.sequence != last[0] + 1:
            watched.gaps += 1
        last[:] = [sample.sequence]
        watched.stamps += 1

    return count


def _newest_stamp(device: Device) -> float | None:
    try:
        if Camera in device.interfaces and isinstance(device, Camera):
            frame = device.latest()
            return None if frame is None else frame.stamp
        if Arm in device.interfaces and isinstance(device, Arm):
            return device.state().stamp
    except DriverError:
        return None  # its link reports it
    return None


def _device(name: str, device: Device, watched: _Watched, cell: Cell) -> Iterator[ReportLine]:
    link = device.link()
    yield ReportLine(
        name,
        link == "ok",
        f"link {link}" if link == "ok" else link,
        "look at its cable, power and settings",
    )
    identity = getattr(device, "identity", None)
    if is_dataclass(identity) and not isinstance(identity, type):
        words = ", ".join(f"{key} {_short(value)}" for key, value in asdict(identity).items())
        yield ReportLine(f"{name} reports", True, words)
    try:
        if Camera in device.interfaces and isinstance(device, Camera):
            yield from _camera(name, device.latest(), watched, cell)
        if Arm in device.interfaces and isinstance(device, Arm):
            yield from _arm(name, device, watched)
        if Gripper in device.interfaces and isinstance(device, Gripper):
            limits = device.limits
            state = device.state()
            words = f"opens {1e3 * limits.width_min:.1f} … {1e3 * limits.width_max:.1f} mm"
            inside = limits.width_min - 1e-3 <= state.width <= limits.width_max + 1e-3
            yield ReportLine(
                f"{name} opening",
                inside,
                f"{1e3 * state.width:.1f} mm; {words}",
                "check finger_offset",
            )
        if isinstance(device, WrenchSensor) and set(FELT) & set(device.interfaces):
            yield from _wrenches(name, device, watched)
    except DriverError as error:
        yield ReportLine(name, False, str(error))


def compared_with_gauge(name: str, gripper: Gripper, gauge: float) -> ReportLine:
    """Compare the opening that a gripper reports with a gauge between its pads [m]."""
    try:
        width = gripper.state().width
    except DriverError as error:
        return ReportLine(f"{name} gauge", False, str(error))
    words = f"it reports {1e3 * width:.1f} mm, the gauge has {1e3 * gauge:.1f} mm"
    return ReportLine(
        f"{name} gauge",
        abs(width - gauge) <= OFF_GAUGE,
        words,
        "compare a second width: a constant error is 'finger_offset', another one 'scale' or its sign",
    )


def _camera(name: str, frame: Frame | None, watched: _Watched, cell: Cell) -> Iterator[ReportLine]:
    if frame is None:
        yield ReportLine(
            f"{name} image", False, "no image came", "look at the camera's cable (USB 3) and power"
        )
        return
    if cell.kind != "frames":
        rate = watched.stamps / WATCHED
        advice = "use a USB 3 port of its own, or a lower rate"
        yield ReportLine(
            f"{name} rate", rate >= SLOWEST_CAMERA, f"{rate:.1f} frames a second", advice
        )
        clock = "the camera's clock is off; its stamps cannot be trusted"
        yield ReportLine(
            f"{name} clock",
            watched.age < 0.5,
            f"images are {1e3 * watched.age:.0f} ms old at most",
            clock,
        )
    K = frame.intrinsics
    height, width = frame.colour.shape[:2]
    fits = (K.width, K.height) == (width, height) and 0.0 < K.cx < width and 0.0 < K.cy < height
    words = f"{width} × {height}, fx {K.fx:.1f} fy {K.fy:.1f} cx {K.cx:.1f} cy {K.cy:.1f}"
    yield ReportLine(f"{name} intrinsics", fits, words, "they do not belong to these images")
    if frame.depth is None:
        yield ReportLine(f"{name} depth", False, "there is none", "switch the depth stream on")
    else:
        share = float((frame.depth > 0.0).mean())
        yield ReportLine(
            f"{name} depth",
            share > 0.05,
            f"{100.0 * share:.0f} % of the pixels",
            "is something in range?",
        )
    if frame.q is not None:
        given = not np.allclose(frame.T_mount_camera, np.eye(4))
        words = "given" if given else "is the identity"
        yield ReportLine(
            f"{name} hand-eye", given, f"transform {words}", "pomona calibrate hand-eye makes it"
        )


def _arm(name: str, arm: Arm, watched: _Watched) -> Iterator[ReportLine]:
    rate = watched.stamps / WATCHED
    limits = arm.limits
    q = arm.state().q
    yield ReportLine(
        f"{name} rate", rate >= SLOWEST_ARM, f"{rate:.0f} states a second", "look at the network"
    )
    yield ReportLine(
        f"{name} description",
        arm.description.is_file(),
        str(arm.description),
        "the file is missing",
    )
    inside = bool(np.all((q >= limits.lower) & (q <= limits.upper)))
    words = " ".join(f"{np.degrees(angle):.1f}°" for angle in q)
    yield ReportLine(
        f"{name} joints",
        inside,
        words,
        "outside the description's limits: is the order of 'joints' right?",
    )


def _wrenches(name: str, sensor: WrenchSensor, watched: _Watched) -> Iterator[ReportLine]:
    rate = watched.stamps / WATCHED
    words = f"{rate:.0f} samples a second of {sensor.rate:.0f}, {watched.gaps} gaps"
    yield ReportLine(
        f"{name} rate",
        rate >= ENOUGH * sensor.rate,
        words,
        "look at the baud rate and the computer's load",
    )
    sample = sensor.latest()
    if sample is None:
        return
    force = float(np.abs(sample.wrenches[:, :3]).max())
    if isinstance(sensor, LoadSensor):
        most = (
            2.0 * GRAVITY * sensor.mass
        )  # the offset of a sensor that was not zeroed may have any direction
        words = f"{force:.1f} N along an axis at rest; it carries {sensor.mass:g} kg, and {sensor.least:g} N count"
        yield ReportLine(
            f"{name} force",
            force <= most,
            words,
            "is 'mass' right? zero the sensor, and look for contact",
        )
    else:
        words = f"{force:.2f} N without contact"
        yield ReportLine(
            f"{name} bias", force < FREE, words, "take the bias with nothing touching the pads"
        )
    yield ReportLine(
        f"{name} range", not any(sample.saturated), "no channel at its end", "a value is at its end"
    )


def _short(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
