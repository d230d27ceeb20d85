"""One depth image with its camera."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pomona.drivers.depth_model import D4XX, DepthModel
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.refinement.checks import check_depth, check_pose
from pomona.skills.perception.refinement.depth_image import DepthImage, ImageBox, RendererName, Triangles
from pomona.skills.perception.refinement.render import render_depth


def _identity() -> Float64:
    return np.eye(4)


@dataclass(frozen=True, slots=True, eq=False)
class DepthLook:
    """One depth image of a fruit, with its camera."""

    depth: DepthImage  # z-depth, shape (h, w) [m]; 0 or not finite where the sensor saw nothing
    intrinsics: Intrinsics  # of the depth image
    depth_model: DepthModel = D4XX  # errors of the depth, as the camera states them
    # pose of this camera in the frame of the look that is refined, shape (4, 4)
    T_camera_look: Float64 = field(default_factory=_identity)
    renderer: RendererName = "pyrender"  # name of the renderer of the virtual depth

    def check(self) -> None:
        """Raise BadDepth for a depth of another shape or type, BadPose for a pose that is not rigid."""
        check_depth(self.depth, self.intrinsics)
        check_pose(self.T_camera_look)

    def render(self, mesh: Triangles, T_look_mesh: Float64, box: ImageBox | None = None) -> tuple[DepthImage, ImageBox]:
        """Render the depth of a mesh as this camera would measure it, float32, shape `box.shape` [m].

        See `render.render_depth` for the arguments, the returned box and the errors.
        """
        return render_depth(mesh, T_look_mesh, self.intrinsics, box, self.renderer)
