"""Data of the rendering of virtual depth: a mesh, a box of the image, its depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64

DepthImage = NDArray[np.float32]
RendererName = Literal["pyrender", "zbuffer"]

NEAR = 0.01  # nothing nearer to the camera than this is rendered [m]


class Triangles(Protocol):
    """A triangle mesh, such as a `FruitModel`: vertices (n, 3) float64 [m], faces (m, 3) integer."""

    @property
    def vertices(self) -> Float64:
        """Shape (n, 3) [m]."""

    @property
    def faces(self) -> NDArray[np.int32]:
        """Indices of vertices, shape (m, 3)."""

    def __hash__(self) -> int: ...


@dataclass(frozen=True, slots=True)
class ImageBox:
    """A rectangle of whole pixels: columns `left` to `right - 1`, rows `top` to `bottom - 1`."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)"""
        return self.bottom - self.top, self.right - self.left

    @property
    def slices(self) -> tuple[slice, slice]:
        """The box's part of an image: `image[box.slices]`."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, margin: int, intrinsics: Intrinsics) -> ImageBox:
        """Return the box with a margin [px], cut to the image."""
        return ImageBox(
            max(self.left - margin, 0),
            max(self.top - margin, 0),
            min(self.right + margin, intrinsics.width),
            min(self.bottom + margin, intrinsics.height),
        )


class DepthRenderer(Protocol):
    """Renders z-depth through the pixel centres of a box."""

    def __call__(self, mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox) -> DepthImage:
        """Return the depth of shape `box.shape`, float32 [m]; 0 where the mesh is not seen."""
