"""Compile one half of the loops while another process compiles the rest: `python -m …compile_beside DESCRIPTION`.

A part whose loops cannot be compiled here is compiled by the run, which reports what is wrong.
"""

from __future__ import annotations

import os
import sys
import threading
from contextlib import suppress
from functools import partial
from pathlib import Path

from pomona.skills.grip import controller as grip
from pomona.skills.motion.grasps.sample import warm_up as warm_sampling
from pomona.skills.motion.occupancy.integrate import warm_up as warm_map
from pomona.skills.motion.robot import RobotModel


def main(description: Path) -> None:
    """Compile map, grip and grasps. Grasps come last: their collision checks are compiled by the run."""
    threading.Thread(target=_end_with_parent, name="pomona-parent", daemon=True).start()
    robot = RobotModel.load(description)
    for part in (warm_map, grip.warm_up, partial(warm_sampling, robot)):
        with suppress(Exception):
            part()


def _end_with_parent() -> None:
    """End when the run's process has: its end of the pipe closes."""
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
