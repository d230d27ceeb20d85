"""Files written by `pomona new driver` and `pomona new cell`."""

from __future__ import annotations

from pomona.tools.kit.piece import Piece

DRIVER = Piece(
    "a driver: here a camera, with options that a cell file may give it",
    {
        "$module/$name.py": '''"""The driver `$name` of a cell file: a camera that looks at a wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pomona.drivers import Camera, ConnectContext, Device, Frame, Intrinsics, Settings, driver
from pomona.executive import LENGTH, Clock, Measure, Whole, value


@dataclass(frozen=True, slots=True, kw_only=True)
class ${Name}Options:
    """A wall, straight ahead."""

    width: int = value(Whole(16, 4096), 64, "pixels of a row")
    distance: float = value(Measure(LENGTH, "1 cm", "10 m"), "50 cm", "of the wall")


class $Name(Device):
    """Shows a new frame at every look. A real driver reads its device in a thread and keeps the newest frame."""

    interfaces = (Camera,)

    def __init__(self, options: ${Name}Options, clock: Clock, name: str = "camera") -> None:
        super().__init__(name)
        self._options, self._clock, self._looks = options, clock, 0

    def latest(self) -> Frame | None:
        width = self._options.width
        camera = Intrinsics(fx=float(width), fy=float(width), cx=width / 2, cy=width / 2, width=width, height=width)
        self._looks += 1
        return Frame(
            stamp=self._clock.now(),
            sequence=self._looks - 1,
            colour=np.full((width, width, 3), 128, np.uint8),
            depth=np.full((width, width), self._options.distance, np.float32),
            intrinsics=camera,
            q=None,
            T_mount_camera=np.eye(4),
            label=self.name,
        )


@driver($Name, ${Name}Options)
def connect(settings: Settings[${Name}Options], context: ConnectContext) -> $Name:
    """`driver: $name`"""
    return $Name(settings.values, context.clock, settings.name)
''',
        "tests/test_$name.py": '''"""The driver `$name`, without a cell."""

from __future__ import annotations

import numpy as np
from pomona.drivers import Camera
from pomona.executive import ManualClock

from $module.$name import $Name, ${Name}Options


def test_it_is_a_camera_whose_frames_count() -> None:
    camera = $Name(${Name}Options(width=32, distance=0.4), ManualClock())
    assert isinstance(camera, Camera)
    first, second = camera.latest(), camera.latest()
    assert first is not None
    assert second is not None
    assert (first.sequence, second.sequence) == (0, 1)
    assert first.depth is not None
    assert np.allclose(first.depth, 0.4)
''',
    },
    entry=("pomona.drivers", "$name", "$module.$name:connect"),
)

CELL = Piece(
    "a cell file: here of mock devices, on which every tree that needs no picture runs dry",
    {
        "$name.yaml": """# A cell to begin with: replace each driver by that of a real device.
name: $name
kind: mock

workspace:                # in the base frame
  table_z: -120 mm
  lower: -0.60 -0.80 -0.14 m
  upper: 0.60 0.20 0.70 m
  poses:                  # joints, in the description's order
    home: -1.36 -0.9 -0.26 -0.4 0.06 -0.9 0.05 rad

world: {driver: mock}
devices:
  arm: {driver: mock-arm, start: home}
  gripper: {driver: mock-gripper}
  fingers: {driver: mock-fingers}
  camera: {driver: mock-camera}
"""
    },
    check="$name.yaml",
)
