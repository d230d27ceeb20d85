"""The Detect skill."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from pomona.drivers.interfaces import Frame
from pomona.executive.account import NOTHING_LEFT
from pomona.executive.ports import Outputs, Port, Ratio
from pomona.executive.skill import SkillFailure, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.views import ProgressView
from pomona.skills.perception.detection.detection import (
    WORKING_WIDTH,
    BoxModelFile,
    Detection,
    DetectorOptions,
    DopeFiles,
    PoseSource,
    Search,
)
from pomona.skills.perception.detection.instances import POLICIES, Instance, rank
from pomona.skills.shared.looking import (
    LOOKING_FAILURES,
    WIDTH_HELP,
    LookingSkill,
    boxes_width,
    picture,
)

SAME_FRUIT = 0.04  # two detections whose lines of sight pass this close at the fruit are the same fruit [m] …
# … unless their measured depths differ by more than this: one hangs behind the other [m]
BEHIND = 0.045


class Detected(Outputs):
    """Outputs of Detect."""

    detection: Detection


class Detect(LookingSkill):
    """Find the fruit in the camera's newest frame and choose one as the target.

    A fruit that this node chose before is chosen again only when `reselect` allows it, since a return to this node
    means that the attempt failed. With `never`, each fruit is chosen at most `max_selections` times, those chosen less
    often first. From the second look on, `fallback_score` replaces `score` when no surer new fruit is left.
    """

    failures = (*LOOKING_FAILURES, "LOW_CONFIDENCE", "POSE_UNSOLVED")

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._chosen: list[Float64] = []
        self._fruit: list[Float64] = []  # where each fruit was that has been chosen, once for each
        self._looks = 0
        self._was_cut = False  # whether the picture's edge has cut the only find of the last look
        self._distance: float | None = None  # of the fruit of the last look [m]

    def run(
        self,
        fruit: Annotated[str, Port(help="fruit to detect: a name in the catalogue, or a path")],
        target: Annotated[
            str, Port(choices=POLICIES, help="choice among several fruit")
        ] = "nearest",
        reselect: Annotated[
            Literal["freely", "last", "never"],
            Port(
                help="whether fruit may be chosen again: freely, as a last choice, or never",
                was="again",
            ),
        ] = "last",
        max_selections: Annotated[
            int,
            Port(
                min=1,
                help="maximum number of choices of one fruit, for reselect: never",
                was="times",
            ),
        ] = 1,
        score: Annotated[Ratio, Port(min=0.0, max=1.0, help="minimum detection score")] = 0.6,
        fallback_score: Annotated[
            Ratio,
            Port(
                min=0.0,
                max=1.0,
                help="minimum score from the second look on, if no new fruit has a higher one; 1: never",
                was="unsure",
            ),
        ] = 1.0,
        working_width: Annotated[
            object,
            Port(help=f"{WIDTH_HELP}; auto: from the distance at the last look"),
        ] = WORKING_WIDTH,
        weights: Annotated[
            str,
            Port(
                help="another weights file, or the name of a shipped one; with config, DOPE's full network"
            ),
        ] = "",
        config: Annotated[
            str, Port(help="config_pose.yaml of DOPE's full network with the given weights")
        ] = "",
        boxes: Annotated[
            str, Port(help="detector of boxes as an ONNX file, which finds the fruit: model.onnx")
        ] = "",
        pose_from: Annotated[
            PoseSource,
            Port(
                help="with boxes, source of the pose: the weights' close look, or the depth in the box"
            ),
        ] = "close_look",
    ) -> Work[Detected]:
        model = self.fruit_model(fruit, weights, needs_weights=not (boxes and pose_from == "depth"))
        frame = self.newest_frame()
        T_base_camera = self.camera_pose(frame)
        width = self.search_width(working_width, model, frame, self._distance)
        options: Search = DetectorOptions(working_width=width)
        if boxes:
            options = BoxModelFile(Path(boxes), pose_from, boxes_width(width))
        elif config:
            if not weights:
                raise self.failure(
                    "NO_WEIGHTS",
                    f"{config} needs the weights that it configures: weights: epoch_60.pth",
                )
            options = DopeFiles(Path(weights), Path(config))
        instances = yield from self.find(frame, model, options)
        self._looks += 1
        if (
            self._looks > 1
            and fallback_score < score
            and not self._sure_and_new(instances, frame, T_base_camera, score)
        ):
            score = fallback_score
        try:
            chosen = self._choose(
                instances, frame, T_base_camera, target, reselect, max_selections, score
            )
        except SkillFailure as failed:
            self.publish(
                "detection", picture(frame, T_base_camera, instances, failed.failure.message, score)
            )
            raise
        self.publish("detection", picture(frame, T_base_camera, instances, chosen, score))
        instance = instances[chosen]
        assert instance.T_camera_object is not None
        assert instance.covariance is not None
        self._tell_progress(model.name, instances, instance, frame, T_base_camera, score)
        self._chosen.append(_place(instance, frame, T_base_camera))
        self._distance = float(instance.T_camera_object[2, 3])
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
            visibility=instance.visibility,
        )
        return Detected(detection)

    def _tell_progress(
        self,
        what: str,
        instances: list[Instance],
        chosen: Instance,
        frame: Frame,
        T_base_camera: Float64,
        score: float,
    ) -> None:
        """Publish which fruit this is among those found now and those chosen before that are gone."""
        place = _place(chosen, frame, T_base_camera)
        if not self._count_near(place, self._fruit, T_base_camera):
            self._fruit.append(place)
        posed = [i for i in instances if i.score >= score and i.T_camera_object is not None]
        places = [_place(instance, frame, T_base_camera) for instance in posed]
        gone = sum(not self._count_near(fruit, places, T_base_camera) for fruit in self._fruit)
        number = next(
            k
            for k, fruit in enumerate(self._fruit, 1)
            if self._count_near(place, [fruit], T_base_camera)
        )
        self.publish("progress", ProgressView(what, number, gone + len(places)))

    def _choose(
        self,
        instances: list[Instance],
        frame: Frame,
        T_base_camera: Float64,
        target: str,
        reselect: str,
        max_selections: int,
        score: float,
    ) -> int:
        """Return the target's index among the instances; fails with the reason without one."""

        def none(code: str, sentence: str) -> SkillFailure:
            best = max((instance.score for instance in instances), default=0.0)
            if code == "NOTHING_FOUND":
                self.account(NOTHING_LEFT, f"picture: {sentence}")
            return self.failure(code, sentence, found=len(instances), best=best)

        if not instances:
            raise none("NOTHING_FOUND", "no fruit in the frame")
        sure = [k for k, instance in enumerate(instances) if instance.score >= score]
        if not sure:
            best = max(instance.score for instance in instances)
            raise none(
                "LOW_CONFIDENCE",
                f"the highest of {len(instances)} scores is {best:.2f}, below {score:.2f}",
            )
        posed = [k for k in sure if instances[k].T_camera_object is not None]
        if not posed:
            raise none("POSE_UNSOLVED", f"{instances[sure[0]].problem}")
        whole = [k for k in posed if not _is_cut(instances[k], frame)]
        words = (
            "" if whole else "the picture's edge cuts the fruit that was found; look from elsewhere"
        )
        if words or self._was_cut:
            self.account("a find at the picture's edge", words)
        self._was_cut = bool(words)
        if words:
            raise none("LOW_CONFIDENCE", words)
        order = [whole[k] for k in rank([instances[k] for k in whole], target)]
        if reselect == "freely":
            return order[0]
        before = {k: self._times_chosen(instances[k], frame, T_base_camera) for k in order}
        rarest = min(order, key=lambda k: before[k])  # the first of those, in the policy's order
        if before[rarest] == 0:
            return rarest
        if reselect == "never":
            if before[rarest] < max_selections:
                return rarest
            often = "before" if max_selections == 1 else f"{max_selections} times"
            raise none("NOTHING_FOUND", f"all {len(order)} fruit in the frame were chosen {often}")
        return order[0]

    def _sure_and_new(
        self, instances: list[Instance], frame: Frame, T_base_camera: Float64, score: float
    ) -> bool:
        """Return True if a fruit with this score has not been chosen before."""
        return any(
            instance.score >= score
            and instance.T_camera_object is not None
            and self._times_chosen(instance, frame, T_base_camera) == 0
            for instance in instances
        )

    def _times_chosen(self, instance: Instance, frame: Frame, T_base_camera: Float64) -> int:
        return self._count_near(_place(instance, frame, T_base_camera), self._chosen, T_base_camera)

    @staticmethod
    def _count_near(place: Float64, others: list[Float64], T_base_camera: Float64) -> int:
        """How many of these places belong to the fruit at a place."""
        eye = T_base_camera[:3, 3]
        ray = (place[:3] - eye) / np.linalg.norm(place[:3] - eye)
        # The pose's distance is that of a CAD-sized fruit: without measured depth compare across the line of sight.
        count = 0
        for other in others:
            behind = (
                abs(ray @ (other[:3] - place[:3])) > BEHIND and place[3] > 0.0 and other[3] > 0.0
            )
            count += not behind and bool(
                np.linalg.norm(np.cross(ray, other[:3] - eye)) < SAME_FRUIT
            )
        return count


def _is_cut(instance: Instance, frame: Frame) -> bool:
    """Return True if the picture ends within half of the fruit: its kind and size are guesses then."""
    assert instance.T_camera_object is not None
    optics = frame.intrinsics
    x, y, z = instance.T_camera_object[:3, 3]
    u, v = optics.fx * x / z + optics.cx, optics.fy * y / z + optics.cy
    corners = instance.keypoints[:8]
    half = 0.5 * float(np.min(np.nanmax(corners, axis=0) - np.nanmin(corners, axis=0)))
    return not (half <= u <= optics.width - half and half <= v <= optics.height - half)


def _place(instance: Instance, frame: Frame, T_base_camera: Float64) -> Float64:
    """Return where the fruit is in the base frame [m], with the measured depth at its centroid where there is one,
    and 1 with such a depth, else 0; shape (4,)."""
    assert instance.T_camera_object is not None
    p_camera = instance.T_camera_object[:3, 3]
    is_measured = 0.0
    if frame.depth is not None:
        u, v = np.round(instance.keypoints[8]).astype(int)
        patch = (
            frame.depth[max(0, v - 2) : v + 3, max(0, u - 2) : u + 3]
            if u >= 0 and v >= 0
            else frame.depth[:0]
        )
        measured = patch[np.isfinite(patch) & (patch > 0.0)]
        if measured.size:
            p_camera = p_camera * (float(np.median(measured)) / p_camera[2])
            is_measured = 1.0
    return np.append(T_base_camera[:3, :3] @ p_camera + T_base_camera[:3, 3], is_measured)
