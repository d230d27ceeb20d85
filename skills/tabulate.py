"""The Tabulate skill."""

from __future__ import annotations

import numpy as np

from executive.skill import Skill
from executive.views import ImageView, Line2, TableView
from skills.perception.measured_fruit import MeasuredFruit

COLUMNS = ("frame", "fruit", "u [px]", "v [px]", "width [mm]", "height [mm]", "distance [m]", "± [mm]", "inliers")


class Tabulate(Skill):
    """Add a measured fruit to the run's table, and its contour to the picture of its frame."""

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._rows: list[tuple[str, ...]] = []
        self._contours: dict[str, list[Line2]] = {}

    def run(
        self,
        measured: MeasuredFruit,
    ) -> None:
        frame = measured.frame
        label = frame.label or f"frame {frame.sequence}"
        contours = self._contours.setdefault(label, [])
        number = len(contours)
        centre = measured.contour.mean(axis=0) if measured.contour.size else np.full(2, np.nan)
        distance = float(np.linalg.norm(measured.T_base_fruit[:3, 3] - measured.T_base_camera[:3, 3]))
        width = float(measured.dimensions[[0, 2]].mean())
        spread = float(np.sqrt(max(measured.covariance[3, 3], 0.0)))
        self._rows.append(
            (
                label,
                str(number),
                f"{centre[0]:.0f}",
                f"{centre[1]:.0f}",
                f"{width * 1e3:.1f}",
                f"{measured.dimensions[1] * 1e3:.1f}",
                f"{distance:.3f}",
                f"{spread * 1e3:.1f}",
                f"{measured.inlier_ratio:.0%}",
            )
        )
        contours.append(Line2(measured.contour, "measured", "refined", closed=True))
        self.publish("measured", TableView(COLUMNS, tuple(self._rows), f"{len(self._rows)} fruit measured"))
        self.publish("overlay", ImageView(frame.colour, tuple(contours), caption=f"{label}: {number + 1} measured"))
        return
