"""Watch of the rest of a path while it is followed: new obstacles in view, and possible collisions with them."""

from pomona.skills.motion.watch.path_watch import Ahead, Braking, PathWatch

__all__ = ["Ahead", "Braking", "PathWatch"]
