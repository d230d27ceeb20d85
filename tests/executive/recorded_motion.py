"""A small record with everything that a policy learns from: joints, a gripper, wrenches and looks with depth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from recorded_events import pose, started

from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import NodeChanged, Published, RunEnded
from pomona.executive.views import ImageView, Pinhole

LOOKS = (0.3, 1.2)
"""Seconds of the run."""
RATE = 50.0
"""Of arm and gripper; the fingers have ten times as many samples."""
JOINTS = 3
END = 2.0


def joints(t: Any) -> Any:
    """Shape (n, JOINTS) [rad], as a record has them: six decimals."""
    return np.round(np.sin(np.asarray(t)[:, None] * (1.0 + np.arange(JOINTS))), 6)


def wrenches(t: Any) -> Any:
    """Shape (n, 12)."""
    return np.round(np.cos(np.asarray(t)[:, None] * (1.0 + np.arange(12))), 6)


PARTS = tuple(
    f"finger_{finger}_{part}"
    for finger in (1, 2)
    for part in ("force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")
)


def look(number: int, size: tuple[int, int] = (48, 64)) -> ImageView:
    rng = np.random.default_rng(number)
    image = rng.integers(0, 255, (*size, 3), np.uint8)
    depth = rng.integers(200, 3000, size).astype(np.float32) * np.float32(1e-3)
    return ImageView(image, depth=depth, pinhole=Pinhole(60.0, 61.0, 31.5, 23.5, pose(0.3)))


def record_motion(
    folder: Path,
    *,
    outcome: str = "success",
    looks: tuple[float, ...] = LOOKS,
    arms: bool = True,
    end: float = END,
) -> Path:
    """Write one; returns its folder."""
    folder.mkdir(parents=True)
    recorder = Recorder(folder)
    recorder.on_event(started(run=folder.name, tree="reach_out"))
    for k in range(1, round(end * 10) + 1):
        t = 0.1 * k
        slow, fast = (t - np.arange(n)[::-1] / n / 10.0 for n in (5, 50))
        if arms:
            q, f = joints(slow), wrenches(fast)
            recorder.read(
                t,
                5 * k,
                {
                    "arm": {
                        "stamp_s": 7.0 + slow,
                        **{f"q_{i + 1}_rad": q[:, i] for i in range(JOINTS)},
                    },
                    "gripper": {"stamp_s": 7.0 + slow, "width_m": np.round(0.05 + 0.01 * slow, 6)},
                    "fingers": {"stamp_s": 7.0 + fast, **dict(zip(PARTS, f.T, strict=True))},
                },
            )
        for number, at in enumerate(looks):
            if abs(at - t) < 1e-9:
                recorder.on_event(Published(t, 5 * k, "a/Detect", "detection", look(number)))
                recorder.on_event(
                    Published(t, 5 * k, "a/Refine", "refine", ImageView(look(9).image))
                )
    recorder.on_event(NodeChanged(end, round(end * 50), "a", "SUCCESS", "", 1))
    recorder.on_event(
        RunEnded(end, round(end * 50), outcome, None, round(end * 50), end, 1.0, None)
    )
    recorder.close()
    assert recorder.problem == ""
    return folder
