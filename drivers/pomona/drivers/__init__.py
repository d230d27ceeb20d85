"""Devices behind Protocols: real, simulated, emulated and mock, told apart by a cell file."""

import os

# PyOpenGL chooses its platform once, when anything imports it first. All that is rendered here is off the screen.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
