"""Measurements of a cell's devices, gathered for the record, which needs every sample."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from pomona.drivers.device import Device
from pomona.drivers.errors import DriverError
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper

WRENCH = ("force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")

MOST = 5000  # maximum number of samples of one device between two calls of `take`: ten seconds at 500 Hz


class Readings:
    """Subscribes to the fingers, and notes arm and gripper whenever it is asked to."""

    def __init__(self, devices: Mapping[str, Device]) -> None:
        self._arms = {name: device for name, device in devices.items() if Arm in device.interfaces}
        self._grippers = {name: device for name, device in devices.items() if Gripper in device.interfaces}
        self._fingers = {name: device for name, device in devices.items() if ForceSensor in device.interfaces}
        self._noted: dict[str, deque[Any]] = {
            name: deque(maxlen=MOST) for name in (*self._arms, *self._grippers, *self._fingers)
        }
        sensors: Any = self._fingers
        self._subscriptions = [sensor.subscribe(self._noted[name].append) for name, sensor in sensors.items()]

    def note(self) -> None:
        """Read arm and gripper once; this uses their last states and does not wait."""
        moving: Any
        for name, moving in (*self._arms.items(), *self._grippers.items()):
            noted = self._noted[name]
            with contextlib.suppress(DriverError):  # the record does not decide whether a silent device ends the run
                state = moving.state()
                if not noted or noted[-1].stamp != state.stamp:
                    noted.append(state)

    def take(self) -> dict[str, dict[str, Any]]:
        """Return the measurements since the last call, by device and quantity.

        Every device gives `stamp_s` on the cell's clock, arms joints and velocities, grippers their width, fingers
        force and torque of each in its pad's frame; shape (n,) each, the name carries the unit.
        """
        taken = {name: [noted.popleft() for _ in range(len(noted))] for name, noted in self._noted.items()}
        return {name: self._columns(name, samples) for name, samples in taken.items() if samples}

    def close(self) -> None:
        """Listen no more."""
        for subscription in self._subscriptions:
            subscription.close()

    def _columns(self, name: str, samples: list[Any]) -> dict[str, Any]:
        columns = {"stamp_s": np.array([sample.stamp for sample in samples])}
        if name in self._arms:
            q, qd = (np.array(rows).T for rows in zip(*((sample.q, sample.qd) for sample in samples), strict=True))
            columns |= {f"q_{k + 1}_rad": joint for k, joint in enumerate(q)}
            return columns | {f"qd_{k + 1}_rad_per_s": joint for k, joint in enumerate(qd)}
        if name in self._grippers:
            return columns | {"width_m": np.array([sample.width for sample in samples])}
        wrenches = np.array([sample.wrenches for sample in samples])
        for finger in range(wrenches.shape[1]):
            for k, part in enumerate(WRENCH):
                columns[f"finger_{finger + 1}_{part}"] = wrenches[:, finger, k]
        return columns
