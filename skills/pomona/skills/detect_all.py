"""The DetectAll skill: every fruit in a frame, not one target."""

from __future__ import annotations

from typing import Annotated

from pomona.executive.account import NOTHING_LEFT
from pomona.executive.ports import Outputs, Port, Ratio
from pomona.executive.skill import Work
from pomona.skills.perception.detection.detection import (
    WORKING_WIDTH,
    AllDetections,
    Detection,
    DetectorOptions,
)
from pomona.skills.shared.looking import LOOKING_FAILURES, WIDTH_HELP, LookingSkill, picture


class AllDetected(Outputs):
    """Outputs of DetectAll."""

    all: Annotated[AllDetections, Port(help="every fruit that one look detected")]


class DetectAll(LookingSkill):
    """Find every fruit in the camera's newest frame."""

    failures = LOOKING_FAILURES

    def run(
        self,
        fruit: Annotated[str, Port(help="fruit to detect: a name in the catalogue, or a path")],
        score: Annotated[Ratio, Port(min=0.0, max=1.0, help="minimum detection score")] = 0.6,
        working_width: Annotated[object, Port(help=WIDTH_HELP)] = WORKING_WIDTH,
        max_places: Annotated[
            int,
            Port(
                min=1,
                max=1000,
                help="maximum number of close looks, highest score first",
                was="most",
            ),
        ] = 100,
        least: Annotated[
            int,
            Port(
                min=0, help="minimum number of fruit, else NOTHING_FOUND; 0: success without fruit"
            ),
        ] = 1,
    ) -> Work[AllDetected]:
        model = self.fruit_model(fruit)
        frame = self.newest_frame()
        T_base_camera = self.camera_pose(frame)
        width = self.search_width(working_width, model, frame, None)
        instances = yield from self.find(
            frame, model, DetectorOptions(working_width=width, most_fruit=max_places)
        )
        self.publish("detection", picture(frame, T_base_camera, instances, "", score))
        sure = [i for i in instances if i.score >= score and i.T_camera_object is not None]
        if len(sure) < least:
            words = f"{len(sure) or 'no'} fruit in {frame.label or 'the frame'}" + (
                f", not {least}" if least > 1 else ""
            )
            self.account(NOTHING_LEFT, f"picture: {words}")
            raise self.failure("NOTHING_FOUND", words, found=len(instances))
        detections = tuple(
            Detection(
                model,
                frame,
                T_base_camera,
                i.T_camera_object,
                i.keypoints,
                i.score,
                i.covariance,
                k,
                len(sure),
                i.visibility,
            )
            for k, i in enumerate(sure)
            if i.T_camera_object is not None and i.covariance is not None
        )
        return AllDetected(AllDetections(detections, frame, T_base_camera))
