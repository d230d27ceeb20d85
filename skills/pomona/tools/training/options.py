"""Options of a data set of synthetic scenes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class SceneKind(StrEnum):
    """Kind of a frame: a robot's table, a randomised heap, fruit among a few leaves, or a tree from near."""

    TABLE = "table"
    RANDOM = "random"
    ORCHARD = "orchard"
    TREE = "tree"


WITHOUT_TREES = (
    0.5,
    0.3,
    0.2,
    0.0,
)  # kinds of scenes in the frames of `make bench-detect`, which never change


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """Options of a data set."""

    width: int = 640  # width, height: picture size [px]
    height: int = 480
    camera: tuple[float, float, float, float] = (610.6, 610.6, 317.7, 238.1)  # fx, fy, cx, cy [px]
    instances: tuple[int, int] = (5, 10)  # fewest and most fruit in a frame
    distractors: int = 5  # things that are no fruit, per frame
    scale: tuple[float, float] = (0.6, 1.15)  # range of the fruit's size against the CAD model
    # range of height over width against the CAD model's; an apple's is then 0.75 to 1.0
    height_ratio: tuple[float, float] = (0.85, 1.133)
    exact: float = 0.15  # part of the instances that keep the CAD model's own size and proportions
    kinds: tuple[float, float, float, float] = (
        0.4,
        0.25,
        0.1,
        0.25,
    )  # how often each kind of scene appears
