"""The skill ChooseFruit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from pomona.applications.crates.freedom import freedom, obstacles_of
from pomona.applications.crates.fruit_scene import FruitScene, SeenFruit
from pomona.drivers import Arm, Workspace
from pomona.executive import LENGTH, Float64, Length, Outputs, Port, Skill, TableView, Work
from pomona.skills.motion import SAME_PLACE, RobotModel, gripper_shape
from pomona.skills.perception import Detection, MeasuredFruit

FREEST = "freest"
NEIGHBOUR = 0.14  # distance of two fruit's middles below which one may be in the other's way [m]: two apples and a finger
MOVED = 8e-3
"""Distance between two measurements that shows that a fruit was moved [m]: they err by 4 mm at most."""
MOVES = 3
"""Number of times that a fruit counts as another one because it was moved."""


class FruitChosen(Outputs):
    """Outputs of ChooseFruit."""

    detection: Annotated[Detection, Port(help="the chosen fruit as detected")]
    measured: Annotated[
        MeasuredFruit, Port(help="the same as measured, with all other fruit beside it")
    ]


@dataclass(slots=True)
class _Tried:
    """A fruit that was chosen before."""

    p_base: Float64
    neighbours: int  # fruit near it at the last choice
    tries: int = 1
    moves: int = 0  # how often it was found elsewhere


class ChooseFruit(Skill):
    """Choose the fruit of a scene that is to be taken next.

    `freest` is the fruit with the most room for the fingers beside it: it makes room for the others. A fruit is chosen
    at most `tries` times, and again after a fruit near it has gone, or it was drawn from a wall.
    """

    devices = (Arm, Workspace)
    moves = ()
    failures = ("NOTHING_LEFT",)

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._tried: list[_Tried] = []

    def run(
        self,
        scene: Annotated[FruitScene, Port(help="every fruit of one look")],
        target: Annotated[
            Literal["freest", "nearest"],
            Port(help="most room for the fingers, or least distance from the camera"),
        ] = "freest",
        tries: Annotated[
            int, Port(min=1, help="how often one fruit is chosen while its neighbours stay")
        ] = 2,
        air: Annotated[
            Length, Port(min="2 mm", max="30 mm", help="between each pad and the fruit")
        ] = LENGTH("3 mm"),
    ) -> Work[FruitChosen]:
        seen = [fruit for fruit in scene.fruit if fruit.measured is not None]
        room = yield from self.compute(self._room, scene, seen, target, air)
        order = sorted(range(len(seen)), key=lambda k: room[k], reverse=True)
        rows = []
        chosen = None
        for k in order:
            before = self._times(scene, seen[k])
            rows.append(
                (
                    f"{k + 1}",
                    f"{1e3 * (room[k][0] if target == FREEST else -room[k][0]):.0f} mm",
                    str(before),
                )
            )
            if chosen is None and before < tries:
                chosen = seen[k]
        self.publish(
            "choice",
            TableView(("fruit", "room" if target == FREEST else "distance", "tries"), tuple(rows)),
        )
        if chosen is None or chosen.measured is None:
            raise self.failure(
                "NOTHING_LEFT", f"all {len(seen)} fruit were tried {tries} times", left=len(seen)
            )
        self._note(scene, chosen)
        return FruitChosen(chosen.detection, scene.with_neighbours(chosen.measured))

    def _room(
        self, scene: FruitScene, seen: list[SeenFruit], target: str, air: float
    ) -> list[tuple[float, ...]]:
        """Return the room of each fruit [m], or its negative distance from the camera."""
        if target == "nearest":
            return [
                (-float(np.linalg.norm(fruit.detection.T_camera_object[:3, 3])),) for fruit in seen
            ]
        robot = RobotModel.load(self.device(Arm).description)
        fingers = gripper_shape(robot)
        workspace = self.device(Workspace)
        rooms: list[tuple[float, ...]] = []
        for fruit in seen:
            assert fruit.measured is not None
            measured = scene.with_neighbours(fruit.measured)
            rooms.append(
                freedom(measured, obstacles_of(measured, workspace), fingers, robot.width_max, air)
            )
        return rooms

    def _times(self, scene: FruitScene, fruit: SeenFruit) -> int:
        """Return how often a fruit was chosen since a neighbour has gone, or it was moved."""
        known = self._known(fruit)
        return 0 if known is None or self._is_another(known, scene, fruit) else known.tries

    def _is_another(self, known: _Tried, scene: FruitScene, fruit: SeenFruit) -> bool:
        return self._neighbours(scene, fruit) < known.neighbours or _was_moved(known, fruit)

    def _note(self, scene: FruitScene, fruit: SeenFruit) -> None:
        known = self._known(fruit)
        number = self._neighbours(scene, fruit)
        if known is None:
            self._tried.append(_Tried(_place(fruit), number))
            return
        known.tries = 1 if self._is_another(known, scene, fruit) else known.tries + 1
        known.moves += _was_moved(known, fruit)
        known.p_base = _place(fruit)
        known.neighbours = number

    def _known(self, fruit: SeenFruit) -> _Tried | None:
        place = _place(fruit)
        return next(
            (one for one in self._tried if np.linalg.norm(one.p_base - place) < SAME_PLACE), None
        )

    def _neighbours(self, scene: FruitScene, fruit: SeenFruit) -> int:
        place = _place(fruit)
        return sum(
            0.0 < float(np.linalg.norm(_place(other) - place)) < NEIGHBOUR for other in scene.fruit
        )


def _place(fruit: SeenFruit) -> Float64:
    """Return where a fruit is in the base frame, as measured if it was, shape (3,) [m]."""
    if fruit.measured is not None:
        return fruit.measured.T_base_fruit[:3, 3]
    place: Float64 = (fruit.detection.T_base_camera @ fruit.detection.T_camera_object)[:3, 3]
    return place


def _was_moved(known: _Tried, fruit: SeenFruit) -> bool:
    return known.moves < MOVES and float(np.linalg.norm(known.p_base - _place(fruit))) > MOVED
