"""Reading a robot's description file with MuJoCo, so that what is wrong with it is said in words about that file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from drivers.errors import UnusableRobotFile


def read_spec(path: Path) -> Any:
    """The file (MJCF or URDF) as an `mujoco.MjSpec` that compiles.

    Raises:
        UnusableRobotFile: it is no XML, or names joints, bodies or frames that it does not have.
    """
    os.environ.setdefault("MUJOCO_GL", "disable")  # no graphics here
    import mujoco  # takes a moment; only this needs it

    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise UnusableRobotFile(
            path, " ".join(str(error).removeprefix("Error: ").split()) or "cannot be read"
        ) from error
    return spec
