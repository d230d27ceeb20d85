"""Watching the rest of a path while it is followed: what comes into view, and whether the arm would get at it."""

from pomona.skills.motion.watch.braking import Braking
from pomona.skills.motion.watch.path_watch import Ahead, PathWatch

__all__ = ["Ahead", "Braking", "PathWatch"]
