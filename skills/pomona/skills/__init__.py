"""The skills of a picking task: each a pure algorithm beside a thin py_trees behaviour."""

import os
from pathlib import Path

from pomona.skills.compiled_code import keep_apart

# PyOpenGL chooses its platform once, when anything imports it first. All that is rendered here is off the screen.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
keep_apart(Path(__file__).parent)
