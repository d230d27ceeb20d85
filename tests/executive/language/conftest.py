"""Dummy skills with the names and ports of the real ones, and the tree that they make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Annotated, Any, ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from pomona.executive.language import BuiltTree, Finding, build, check, read
from pomona.executive.ports import LENGTH, TIME, Port, Ports
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill, Work
from pomona.executive.skill_testing import BenchContext


class Arm:
    """A device."""


class Camera:
    """Another device."""


@dataclass(frozen=True)
class Detection:
    score: float = 0.9
    index: int = 0


@dataclass(frozen=True)
class FruitPose:
    dimensions: NDArray[np.float64] = field(default_factory=lambda: np.array([0.07, 0.06, 0.07]))
    inlier_ratio: float = 0.8
    method: str = "uniform"


@dataclass(frozen=True)
class Grasp:
    index: int
    width: float = 0.08


@dataclass(frozen=True)
class Candidates:
    grasps: tuple[Grasp, ...] = ()
    attempt: int = 1

    @property
    def best(self) -> Grasp | None:
        return self.grasps[0] if self.grasps else None


@dataclass(frozen=True)
class Path:
    duration: float = 1.0


class Hold(Enum):
    SOFT = "soft"
    FIRM = "firm"


class Planner(Enum):
    RRT_CONNECT = "RRTConnect"
    RRT_STAR = "RRTstar"


class Scripted(Skill):
    """Ends as in `script`: an entry per start, a failure code or None; the last one stays."""

    script: tuple[str | None, ...] = (None,)

    def result(self, **inputs: Any) -> dict[str, Any]:
        return {}

    def run(self, **inputs: Any) -> Work:
        self.seen = inputs
        code = self.script[min(self.starts, len(self.script)) - 1]
        yield f"{self.name} works"
        if code is not None:
            raise self.failure(code, f"{self.name} could not ({code})", start=self.starts)
        return self.result(**inputs)


class MoveTo(Scripted):
    """Move the arm to a named pose."""

    inputs = Ports(pose=Port(str, help="named pose"), variation=Port(int, default=1, min=1))
    devices = (Arm,)
    failures = ("NO_PATH", "MOTION_FAILED")


class Detect(Scripted):
    """Find a fruit in one frame."""

    inputs = Ports(
        fruit=str, policy=Port(str, default="nearest", choices=("nearest", "largest", "best"))
    )
    outputs = Ports(detection=Detection)
    devices = (Camera,)
    failures = ("NO_FRUIT", "NO_FRAME")

    def result(self, **inputs: Any) -> dict[str, Any]:
        return {"detection": Detection()}


class Refine(Scripted):
    """Correct position and size."""

    inputs = Ports(detection=Detection)
    outputs = Ports(measured=FruitPose)
    failures = ("NO_DEPTH", "TOO_FEW_INLIERS")

    def result(self, **inputs: Any) -> dict[str, Any]:
        return {"measured": FruitPose()}


class SampleGrasp(Scripted):
    """Candidates around a fruit."""

    inputs = Ports(
        around=FruitPose,
        radius=Port(LENGTH, default="120 mm", min="20 mm", max="1 m"),
        tried=Port(Grasp, default=None),
    )
    outputs = Ports(candidates=Candidates)
    failures = ("NO_CANDIDATE",)

    def result(self, **inputs: Any) -> dict[str, Any]:
        return {"candidates": Candidates((Grasp(self.starts), Grasp(99)), self.starts)}


class Plan(Scripted):
    """A path to one of the candidates."""

    inputs = Ports(
        to=Candidates,
        budget=Port(TIME, default="1 s", min="1 ms"),
        planner=Port(Planner, default=Planner.RRT_CONNECT),
        clearance=Port(LENGTH, default="5 mm", min="0 mm", max="50 mm"),
    )
    outputs = Ports(grasp=Grasp, path=Path)
    failures = ("NO_PATH", "TIMEOUT", "GOAL_IN_COLLISION")

    def result(self, **inputs: Any) -> dict[str, Any]:
        return {"grasp": inputs["to"].grasps[0], "path": Path()}


class Follow(Scripted):
    """Follow a path."""

    inputs = Ports(path=Path)
    devices = (Arm,)
    failures = ("MOTION_FAILED",)


class Approach(Scripted):
    """Go to the fruit."""

    inputs = Ports(grasp=Grasp)
    devices = (Arm,)
    failures = ("CONTACT",)


class SlipAvoidGrasp(Scripted):
    """Grip without slip."""

    inputs = Ports(fruit=FruitPose)
    outputs = Ports(hold=Hold)
    failures = ("NO_CONTACT", "SLIPPED")

    def result(self, **inputs: Any) -> dict[str, Any]:
        return {"hold": Hold.SOFT}


class Lift(Scripted):
    """Lift the held fruit."""

    inputs = Ports(height=Port(LENGTH, default="100 mm", min="0 mm"), hold=Hold)
    devices = (Arm,)
    failures = ("DROPPED",)
    renamed_failures: ClassVar = {"FELL": "DROPPED"}


class Retreat(Scripted):
    """Open and go back."""

    inputs = Ports(distance=Port(LENGTH, default="100 mm"))
    devices = (Arm,)
    failures = ("MOTION_FAILED",)


class Beep(Skill):
    """Make a noise; cannot fail."""

    def run(
        self, times: Annotated[int, Port(min=1, max=10, was="rings")] = 1, loud: bool = False
    ) -> None:
        return None


class Aim(Skill):
    """Takes every sort of value."""

    inputs = Ports(
        pose=Port(np.ndarray, default=None),
        grasp=Port(Grasp, default=None),
        share=Port(Port(float).type, default=0.5),
        hold=Port(Hold, default=None),
    )
    failures = ("OUT_OF_REACH",)

    def run(self, **inputs: Any) -> None:
        self.seen = inputs


SKILLS = (
    MoveTo, Detect, Refine, SampleGrasp, Plan, Follow, Approach, SlipAvoidGrasp, Lift, Retreat, Beep, Aim,
)  # fmt: skip

PICK_APPLE = """\
# Pick one fruit from the table and hold it above its place.
pomona: 1
tree: pick_apple

parameters:                       # pomona run … --set attempts=20
  fruit:     {type: text,   default: apple}
  looks:     {type: int,    default: 3,      min: 1}
  attempts:  {type: int,    default: 12,     min: 1, help: grasp attempts before giving up}
  radius:    {type: length, default: 120 mm, help: pre-grasp sphere around the fruit}

root:
  sequence:
    - perceive: {fruit: "{fruit}", measured: "{measured}"}
      retry: "{looks}"

    - sequence:                   # one attempt; every try takes the next sample of the sphere
        - SampleGrasp: {around: "{measured}", radius: "{radius}", tried: "{grasp}", candidates: "{candidates}"}
        - fallback:
            - Plan: {to: "{candidates}", grasp: "{grasp}", path: "{path}", budget: 200 ms}
            - Plan: {to: "{candidates}", grasp: "{grasp}", path: "{path}", budget: 2 s, planner: RRTstar}
              when: "failure.code in [NO_PATH, TIMEOUT]"
        - Follow:   {path: "{path}"}
        - Approach: {grasp: "{grasp}"}
        - SlipAvoidGrasp: {fruit: "{measured}", hold: "{hold}"}
        - Lift: {height: 150 mm, hold: "{hold}"}
      name: Attempt
      retry: "{attempts}"
      on_failure:                 # before the next try
        Retreat: {}

subtrees:
  perceive:
    in:  {fruit: text}
    out: {measured: fruit_pose}
    root:
      sequence:
        - MoveTo: {pose: observe, variation: "{retry.attempt}"}
        - Detect: {fruit: "{fruit}", detection: "{detection}"}
          timeout: 5 s
        - Refine: {detection: "{detection}", measured: "{measured}"}
"""

HEAD = "pomona: 1\ntree: t\n"


@pytest.fixture
def skills() -> Registry:
    return Registry({skill.__name__: skill for skill in SKILLS})


@pytest.fixture
def pick_apple() -> str:
    return PICK_APPLE


@pytest.fixture
def findings_of(skills: Registry) -> Callable[..., list[Finding]]:
    """Findings of a tree given from `root:` on (or from any other key)."""

    def find(body: str, **options: Any) -> list[Finding]:
        return check(
            read(body if "pomona: 1" in body else HEAD + body, "t.yaml"), skills, **options
        )

    return find


@dataclass
class Running:
    """A built tree with the parts needed to tick it."""

    tree: BuiltTree
    context: BenchContext

    def skill(self, path: str) -> Any:
        return self.tree.behaviours[path]

    def script(self, path: str, *codes: str | None) -> Running:
        self.skill(path).script = codes
        return self

    def tick(self, times: int = 1) -> str:
        for _ in range(times):
            self.tree.board.tick += 1
            self.tree.root.tick_once()
            self.context.clock.advance(0.02)
        return self.tree.root.status.name

    def run(self, limit: int = 2000) -> str:
        for _ in range(limit):
            if self.tick() != "RUNNING":
                return self.tree.root.status.name
        raise AssertionError("still running")

    def value(self, key: str) -> Any:
        entry = self.tree.board.get(key)
        return None if entry is None else entry.value


@pytest.fixture
def built(skills: Registry) -> Callable[..., Running]:
    """Build a tree given from `root:` on."""

    def make(body: str, **options: Any) -> Running:
        context = BenchContext()
        text = body if "pomona: 1" in body else HEAD + body
        return Running(build(read(text, "t.yaml"), skills, context=context, **options), context)

    return make
