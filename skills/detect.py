"""The Detect skill."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Arm, Camera, Frame
from executive.ports import RATIO, TIME, Port, Ports
from executive.skill import Skill, Work
from executive.views import ImageView, Line2, Pinhole
from skills.motion.robot.model import RobotModel
from skills.perception.detection import reprojection
from skills.perception.detection.compact_detector import CompactDetector, DetectorOptions
from skills.perception.detection.detection import Detection
from skills.perception.detection.errors import BadFrame, BadWeights
from skills.perception.detection.instances import POLICIES, Instance, find_instances, rank
from skills.perception.fruit import FruitModel, load_fruit
from skills.perception.fruit.catalogue import SHIPPED_WEIGHTS
from skills.perception.fruit.errors import FruitError

F64 = NDArray[np.float64]

SAME_FRUIT = 0.04
"""Two detections whose lines of sight pass this close at the fruit are the same fruit [m]."""

_EDGES = np.array([0, 1, 2, 3, 0, 4, 5, 1, 5, 6, 2, 6, 7, 3, 7, 4])


class Detect(Skill):
    """Find the fruit in the camera's newest frame and choose one as the target.

    A fruit that this node chose before is chosen again only when `again` allows it: that the tree comes back here means
    that it did not work out. With `never`, `times` says how often one fruit is chosen, those chosen less often first.
    From its second look on it may choose what it doubts (`unsure`), when nothing surer is left that is new.
    """

    inputs = Ports(
        fruit=Port(str, help="which fruit to look for: a name in the catalogue, or a path"),
        target=Port(str, default="nearest", choices=POLICIES, help="which one, when there are several"),
        index=Port(int, default=0, min=0, max=99, help="place by falling score, for target: index"),
        again=Port(
            str,
            default="last",
            choices=("freely", "last", "never"),
            help="fruit chosen before: like any other, only when nothing else is left, or not at all",
        ),
        times=Port(int, default=1, min=1, help="how often one fruit may be chosen, for again: never"),
        score=Port(RATIO, default=0.6, min=0.0, max=1.0, help="least belief that it is this fruit"),
        unsure=Port(
            RATIO,
            default=1.0,
            min=0.0,
            max=1.0,
            help="least belief from the second look on, when nothing surer is left that is new; 1: never",
        ),
        max_age=Port(TIME, default="500 ms", min="1 ms", max="60 s", help="older frames are refused"),
        working_width=Port(
            int, default=320, min=64, max=4096, help="width at which the whole picture is searched [px]"
        ),
    )
    outputs = Ports(detection=Detection)
    devices = (Camera,)
    failures: ClassVar[tuple[str, ...]] = (
        "NO_FRAME",
        "STALE_FRAME",
        "NOTHING_FOUND",
        "LOW_CONFIDENCE",
        "POSE_UNSOLVED",
        "NO_WEIGHTS",
    )

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._chosen: list[F64] = []
        self._looks = 0

    def prepare(self) -> None:
        """Load and warm the apple's detector; another fruit's is loaded at its first use."""
        fruit = load_fruit("apple")
        if fruit.weights is None:
            raise BadWeights(
                SHIPPED_WEIGHTS / "apple.pt", "the apple's weights are missing: restore them, or make train-detect"
            )
        _detector(fruit.weights, DetectorOptions())

    def run(  # type: ignore[override]
        self,
        fruit: str,
        target: str,
        index: int,
        again: str,
        times: int,
        score: float,
        unsure: float,
        max_age: float,
        working_width: int,
    ) -> Work:
        model = self._model(fruit)
        frame = self._frame(max_age)
        T_base_camera = self._camera_pose(frame)
        try:
            instances = yield from self.compute(
                find_in_frame, frame, model, DetectorOptions(working_width=working_width)
            )
        except BadFrame as error:
            raise self.failure("NO_FRAME", f"the camera's frame cannot be used: {error}") from error
        self._looks += 1
        if self._looks > 1 and unsure < score and not self._sure_and_new(instances, frame, T_base_camera, score):
            score = unsure
        chosen = self._choose(instances, frame, T_base_camera, target, index, again, times, score)
        self.publish("detection", picture(frame, T_base_camera, instances, chosen, score))
        if isinstance(chosen, str):
            code, sentence = chosen.split(": ", 1)
            raise self.failure(
                code, sentence, found=len(instances), best=max((i.score for i in instances), default=0.0)
            )
        instance = instances[chosen]
        assert instance.T_camera_object is not None
        assert instance.covariance is not None
        self._chosen.append(_place(instance, frame, T_base_camera))
        detection = Detection(
            fruit=model,
            frame=frame,
            T_base_camera=T_base_camera,
            T_camera_object=instance.T_camera_object,
            keypoints=instance.keypoints,
            score=instance.score,
            covariance=instance.covariance,
            index=chosen,
            found=sum(i.score >= score for i in instances),
        )
        return {"detection": detection}

    def _model(self, fruit: str) -> FruitModel:
        try:
            model = load_fruit(fruit)
        except FruitError as error:
            raise self.failure("NO_WEIGHTS", str(error), fruit=fruit) from error
        if model.weights is None:
            raise self.failure("NO_WEIGHTS", f"there are no detector weights for {model.name}: train them", fruit=fruit)
        return model

    def _frame(self, max_age: float) -> Frame:
        frame = self.device(Camera).latest()
        if frame is None:
            raise self.failure("NO_FRAME", "the camera has not delivered a frame yet")
        age = self.clock.now() - frame.stamp
        if age > max_age:
            raise self.failure(
                "STALE_FRAME", f"the newest frame is {age:.2f} s old, {max_age:.2f} s are allowed", age_s=age
            )
        return frame

    def _camera_pose(self, frame: Frame) -> F64:
        if frame.q is None:
            return frame.T_mount_camera
        # Asked for only when the camera rides on an arm, so that cells without one can detect too.
        robot = RobotModel.load(self.context.device(Arm).description)
        T_base_camera: F64 = robot.fk(frame.q) @ frame.T_mount_camera
        return T_base_camera

    def _choose(
        self,
        instances: list[Instance],
        frame: Frame,
        T_base_camera: F64,
        target: str,
        index: int,
        again: str,
        times: int,
        score: float,
    ) -> int | str:
        """The target's index, or a failure as "CODE: sentence"."""
        if not instances:
            return "NOTHING_FOUND: no fruit in the frame"
        sure = [k for k, instance in enumerate(instances) if instance.score >= score]
        if not sure:
            best = max(instance.score for instance in instances)
            return f"LOW_CONFIDENCE: the surest of {len(instances)} candidates scores {best:.2f}, not {score:.2f}"
        posed = [k for k in sure if instances[k].T_camera_object is not None]
        if not posed:
            return f"POSE_UNSOLVED: {instances[sure[0]].problem}"
        order = [posed[k] for k in rank([instances[k] for k in posed], target, index)]
        if not order:
            return f"NOTHING_FOUND: there are {len(posed)} fruit in the frame, number {index} was asked for"
        if again == "freely" or target == "index":
            return order[0]
        before = {k: self._times_chosen(instances[k], frame, T_base_camera) for k in order}
        rarest = min(order, key=lambda k: before[k])  # the first of those, in the policy's order
        if before[rarest] == 0:
            return rarest
        if again == "never":
            if before[rarest] < times:
                return rarest
            often = "before" if times == 1 else f"{times} times"
            return f"NOTHING_FOUND: all {len(order)} fruit in the frame were chosen {often}"
        return order[0]

    def _sure_and_new(self, instances: list[Instance], frame: Frame, T_base_camera: F64, score: float) -> bool:
        """Whether a fruit can be chosen that has not been before."""
        return any(
            instance.score >= score
            and instance.T_camera_object is not None
            and self._times_chosen(instance, frame, T_base_camera) == 0
            for instance in instances
        )

    def _times_chosen(self, instance: Instance, frame: Frame, T_base_camera: F64) -> int:
        place = _place(instance, frame, T_base_camera)
        eye = T_base_camera[:3, 3]
        ray = (place - eye) / np.linalg.norm(place - eye)
        # The pose's distance is that of a CAD-sized fruit: compare across the line of sight.
        return sum(bool(np.linalg.norm(np.cross(ray, before - eye)) < SAME_FRUIT) for before in self._chosen)


def _place(instance: Instance, frame: Frame, T_base_camera: F64) -> F64:
    """Where the fruit is in the base frame, with the measured depth at its centroid where there is one, (3,) [m]."""
    assert instance.T_camera_object is not None
    p_camera = instance.T_camera_object[:3, 3]
    if frame.depth is not None:
        u, v = np.round(instance.keypoints[8]).astype(int)
        patch = frame.depth[max(0, v - 2) : v + 3, max(0, u - 2) : u + 3] if u >= 0 and v >= 0 else frame.depth[:0]
        measured = patch[np.isfinite(patch) & (patch > 0.0)]
        if measured.size:
            p_camera = p_camera * (float(np.median(measured)) / p_camera[2])
    place: F64 = T_base_camera[:3, :3] @ p_camera + T_base_camera[:3, 3]
    return place


@lru_cache(maxsize=4)
def _detector(weights: Path, options: DetectorOptions) -> CompactDetector:
    detector = CompactDetector.load(weights, options)
    detector.warm_up()
    reprojection.warm_up()
    return detector


def find_in_frame(frame: Frame, fruit: FruitModel, options: DetectorOptions) -> list[Instance]:
    """Every fruit of a frame; its detector is loaded once in a process."""
    assert fruit.weights is not None
    return find_instances(_detector(fruit.weights, options), frame.colour, frame.intrinsics.K, fruit)


def picture(frame: Frame, T_base_camera: F64, instances: list[Instance], chosen: int | str, score: float) -> ImageView:
    """The frame with the cuboids that were found; `chosen` is the target's index, or why there is none."""
    lines = []
    for k, instance in enumerate(instances):
        if instance.score < score:
            continue
        style = "found" if k == chosen else "muted"
        lines.append(Line2(instance.keypoints[_EDGES], f"{k}: {instance.score:.2f}", style))
    centres = np.array([i.keypoints[8] for i in instances if i.score >= score]).reshape(-1, 2)
    target = f"target {chosen}" if isinstance(chosen, int) else chosen
    optics = frame.intrinsics
    pinhole = Pinhole(optics.fx, optics.fy, optics.cx, optics.cy, T_base_camera)
    return ImageView(frame.colour, tuple(lines), centres, f"{len(lines)} found, {target}", frame.depth, pinhole)
