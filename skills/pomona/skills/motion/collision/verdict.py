"""Distances to keep, and the message for a violation."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.executive.values.arrays import Float64


@dataclass(frozen=True, slots=True)
class Margins:
    """Distances to keep, body by body [m]: with one margin for all, large fruit would not fit between the fingers."""

    # arm, gripper, fingers, held: of the links, of parts fixed on the flange, of fingers and pads, of held fruit, from
    # everything in the world
    arm: float = 0.010
    gripper: float = 0.006
    fingers: float = 0.002
    held: float = 0.002
    itself: float = 0.004  # of the robot's parts from each other

    def scaled(self, factor: float) -> Margins:
        """Return all margins times a factor, for example of a fallback in the tree."""
        return Margins(*(factor * m for m in (self.arm, self.gripper, self.fingers, self.held, self.itself)))


@dataclass(frozen=True, slots=True, eq=False)
class Collision:
    """Two things that are closer than they may be."""

    geom: str  # geom, body: the robot's part, by the names of its shape and of its body
    body: str
    other: str  # the obstacle's name ("map", "table", "target" …), or the robot's other body
    depth: float  # by how much the margin is violated [m]; larger than the margin means contact
    margin: float  # the distance that was to be kept [m]
    point: Float64  # the robot's point where it is deepest, in the base frame, shape (3,) [m]
    q: Float64  # the posture, shape (dof,) [rad]
    at: float  # where on a path: number of the segment plus the share of it; 0 for a single posture
    itself: bool  # True for a collision of the robot with itself

    def __str__(self) -> str:
        x, y, z = self.point
        what = f"the arm's own {self.other}" if self.itself else f"the {self.other}"
        gap = self.margin - self.depth
        how = f"touches {what}" if gap <= 0.0 else f"comes within {1e3 * gap:.1f} mm of {what}"
        kept = (
            f"{1e3 * self.margin:.0f} mm are to be kept" if self.margin >= 0.0 else "it may be left, not pressed more"
        )
        return f"{self.body} {how} at ({x:.3f}, {y:.3f}, {z:.3f}) m; {kept}"
