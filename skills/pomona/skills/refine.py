"""The Refine skill."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated, Any

import numpy as np

from pomona.drivers.interfaces import Intrinsics, Workspace
from pomona.executive.ports import LENGTH, Length, Outputs, Port, Ratio
from pomona.executive.skill import Skill, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.views import ImageView, Line2
from pomona.skills.geometry import transform
from pomona.skills.perception.detection.detection import Detection
from pomona.skills.perception.frame_check import MISMATCHES, FrameProblem, frame_problem
from pomona.skills.perception.fruit import Mesh
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.perception.refinement.errors import RefineError
from pomona.skills.perception.refinement.measure import FITS, measure, outline, refine
from pomona.skills.perception.refinement.render import (
    DepthLook,
    Limits,
    RendererName,
    render_depth,
    usable_renderer,
)
from pomona.skills.shared.frame_trust import earlier_poses, mismatch, note_pose

_SMALL_CAMERA = Intrinsics(400.0, 400.0, 100.0, 100.0, 201, 201)
_SOMETHING = Mesh(
    0.05 * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]),
    np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], dtype=np.int32),
)
"""A tetrahedron of a fruit's size, to render before the first fruit is there [m]."""


class Refined(Outputs):
    """Outputs of Refine."""

    measured: MeasuredFruit


class Refine(Skill):
    """Correct a detection's position and size from the depth image.

    The table in the depth image is compared with the cell file's first, and depth with colour.
    """

    devices = (Workspace,)
    moves = ()
    failures = (
        *MISMATCHES,
        "NO_DEPTH",
        "TOO_FEW_INLIERS",
        "SIZE_OUT_OF_RANGE",
        "AT_BOUND",
        "NOT_ITS_SHAPE",
        "RENDER_FAILED",
    )

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._reported = False

    def prepare(self) -> None:
        """Open the renderer, and import and compile the measurement, which takes seconds."""
        using, _ = usable_renderer("pyrender")
        with suppress(RefineError):
            T = transform(translation=(0.0, 0.0, 0.5))
            virtual_depth, box = render_depth(_SOMETHING, T, _SMALL_CAMERA, using=using)
            depth = np.zeros((_SMALL_CAMERA.height, _SMALL_CAMERA.width), np.float32)
            depth[box.slices] = virtual_depth
            refine(DepthLook(depth, _SMALL_CAMERA, renderer=using), T, _SOMETHING)

    def run(
        self,
        detection: Annotated[
            Detection, Port(help="detected fruit, at the pose for a fruit of the CAD model's size")
        ],
        method: Annotated[
            str,
            Port(
                choices=(*FITS, "none"),
                help="shape: height and widths apart; uniform: one scale; paper: rendered again; none: as detected",
            ),
        ] = "shape",
        earlier: Annotated[
            MeasuredFruit | None,
            Port(help="measurement of the same fruit from another viewpoint; its looks are fused"),
        ] = None,
        inlier_band: Annotated[
            Length,
            Port(
                min="0.5 mm",
                max="50 mm",
                help="depth agrees within this, or within its noise if larger",
            ),
        ] = LENGTH("4 mm"),
        min_inliers: Annotated[
            Ratio, Port(min=0.0, max=1.0, help="minimum fraction of the depth that must agree")
        ] = 0.3,
        smallest: Annotated[
            Ratio, Port(min=0.01, max=1.0, help="minimum size relative to the CAD model")
        ] = 0.4,
        largest: Annotated[
            Ratio, Port(min=1.0, max=10.0, help="maximum size relative to the CAD model")
        ] = 1.6,
    ) -> Work[Refined]:
        workspace = self.device(Workspace)
        limits = Limits(inlier_band, min_inliers, (smallest, largest))
        using, note = usable_renderer("pyrender")
        if note and not self._reported:  # once in a run, not at each look
            self._reported = True
            yield note
        past = tuple(earlier_poses(self, detection.frame))
        how = method, limits, using, workspace.table_z, earlier
        try:
            measured = yield from self.compute(_measure, detection, workspace, past, how)
        except RefineError as problem:
            raise self.failure(problem.code, str(problem), **vars(problem)) from problem
        note_pose(self, detection.frame, detection.T_base_camera)
        if isinstance(measured, FrameProblem):
            raise mismatch(self, detection.frame, measured)
        self.publish("refine", _picture(detection, measured, using))
        if measured.doubt:
            yield measured.doubt
        return Refined(measured)


def _measure(
    detection: Detection,
    workspace: Workspace,
    earlier: Sequence[tuple[float, Float64]],
    how: tuple[Any, ...],
) -> MeasuredFruit | FrameProblem:
    """Return the measured fruit, or the problem of its frame; `how` holds the other arguments of `measure`."""
    problem = frame_problem(detection.frame, detection.T_base_camera, workspace, earlier)
    return problem or measure(detection, *how)


def _picture(detection: Detection, measured: MeasuredFruit, using: RendererName) -> ImageView:
    """Return the camera's image with the outlines of the model as detected and of the fruit as measured."""
    detected = outline(
        *render_depth(
            detection.fruit, detection.T_camera_object, detection.frame.intrinsics, using=using
        )
    )
    size = " × ".join(f"{1e3 * d:.1f}" for d in measured.dimensions)
    deviation = 1e3 * float(np.sqrt(np.max(np.diag(measured.covariance)[3:])))
    return ImageView(
        image=detection.frame.colour,
        lines=(
            Line2(detected, "detected", "muted", closed=True),
            Line2(measured.contour, "measured", "refined", closed=True),
        ),
        caption=f"{measured.method}: {size} mm (± {deviation:.1f}), {measured.inlier_ratio:.0%} of the depth agrees"
        + (f"; {measured.doubt}" if measured.doubt else ""),
    )
