"""The picture of a run: the camera's image, the path in the scene, forces over time, the failure."""

from __future__ import annotations

import textwrap
from collections import defaultdict
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from pomona.executive.images import EXTRA
from pomona.executive.palette import BAD, INK, MUTED, OVERLAY, SCENE, SERIES
from pomona.executive.reasons import Reason, latest_leaf
from pomona.executive.running.events import (
    Event,
    NodeChanged,
    Published,
    RunEnded,
    RunStarted,
    TreeChanged,
)
from pomona.executive.values.installation import need
from pomona.executive.views import ImageView, SceneView, SeriesView

MILLI = {
    "m": ("mm", 1e3),
    "m/s": ("mm/s", 1e3),
}  # units of small quantities in plots, and their number per SI unit

KINDS = {"N": "force", "N·m": "torque", "m": "length", "m/s": "speed", "rad": "angle", "s": "time"}
"""Axis labels for several quantities of one unit."""

SMALLEST_SPAN = {"N": 1.0, "mm": 1.0, "mm/s": 1.0}  # least height of an axis, by its unit
GAP = 0.5  # longest time between two samples of one curve [s]


class Picture:
    """Gathers the views of a run; `save` draws the newest of each."""

    def __init__(self) -> None:
        self._images: dict[str, ImageView] = {}
        self._scenes: dict[str, SceneView] = {}
        self._series: dict[str, list[SeriesView]] = defaultdict(list)
        self._names: dict[str, str] = {}
        self._failed: dict[str, float] = {}
        self._reason: Reason | None = None
        self._ended = 0.0

    def on_event(self, event: Event) -> None:
        """Keep a published view, the moment of a node's last failure, and the run's reason."""
        if isinstance(event, (RunStarted, TreeChanged)):
            self._names.update((node["path"], node["name"]) for node in event.nodes)
        elif isinstance(event, NodeChanged) and event.status == "FAILURE":
            self._failed[event.path] = event.t
        elif isinstance(event, RunEnded) and event.outcome != "success":
            self._reason = event.reason and latest_leaf(event.reason)
            self._ended = event.t
        if not isinstance(event, Published):
            return
        if isinstance(event.value, ImageView):
            self._look(event.topic, event.value)
        elif isinstance(event.value, SceneView):
            self._scenes[event.topic] = event.value
        elif isinstance(event.value, SeriesView) and event.value.t.size:
            self._series[event.topic].append(event.value)

    def _look(self, topic: str, view: ImageView) -> None:
        """Keep the last image with drawings, and all drawings on it."""
        if view.image is not None:
            shown = list(self._images.values())
            if not any(
                one.image is not None and np.array_equal(one.image, view.image) for one in shown
            ):
                if not _has_drawings(view) and any(_has_drawings(one) for one in shown):
                    return
                self._images.clear()
        self._images[topic] = view

    @property
    def empty(self) -> bool:
        """True if no view was published that can be drawn."""
        return not (self._images or self._scenes or self._series)

    def save(self, target: Path | BinaryIO, title: str) -> None:
        """Draw all views into one PNG."""
        need("matplotlib", EXTRA, "the picture of a run")
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # takes half a second
        from matplotlib.figure import Figure

        figure = Figure(
            figsize=(14, 8.4), dpi=100
        )  # margins are set by hand: a layout draws everything twice
        FigureCanvasAgg(figure)
        figure.suptitle(title, fontsize=13, x=0.01, y=0.985, ha="left", parse_math=False)
        if self._reason is not None:
            figure.text(
                0.01, 0.93, self._why(), fontsize=10, color=BAD, va="center", parse_math=False
            )
        units = self._by_unit()
        heights = [2 if len(lines) > 1 else 1 for lines in units.values()]
        pictured = any(view.image is not None for view in self._images.values())
        spatial = any(view.lines or view.points or view.meshes for view in self._scenes.values())
        below = (
            0.17 * sum(heights) ** 0.7 if pictured or spatial else 0.79
        )  # share of the height for the curves
        margins = {"left": 0.055, "right": 0.985}
        images = figure.add_gridspec(
            1,
            3,
            width_ratios=[1.25 if pictured else 0.01, 0.42, 1.0],
            wspace=0.04,
            top=0.86,
            bottom=below + 0.06 if units else 0.03,
            **margins,
        )
        look = figure.add_subplot(images[0])
        beside = figure.add_subplot(images[1])
        self._draw_images(look)
        beside.set_axis_off()
        _legend(look, beside, "upper left")  # on the image it would hide the fruit
        if spatial:
            first = beside.get_legend()
            scene = figure.add_subplot(images[2], projection="3d")
            self._draw_scene(scene)
            _legend(scene, beside, "lower left")
            if first is not None:
                beside.add_artist(first)
        if units:
            grid = figure.add_gridspec(
                len(units),
                1,
                height_ratios=heights,
                hspace=0.12,
                left=0.055,
                right=0.82,
                top=below,
                bottom=0.06,
            )
            above = None
            for row, (unit, lines) in enumerate(units.items()):
                above = figure.add_subplot(
                    grid[row], sharex=above
                )  # one moment is one place in all curves
                self._draw_series(above, unit, lines)
                above.tick_params(labelbottom=row == len(units) - 1)
            assert above is not None
            above.set_xlabel("time [s]")
        figure.savefig(
            target, pil_kwargs={"compress_level": 2}
        )  # a third of the time of the default, a sixth larger

    def _why(self) -> str:
        """Return the reason in a line: the node, its code, its message."""
        assert self._reason is not None
        name = self._names.get(self._reason.node_path, self._reason.node_path)
        words = (
            f"{name} {self._reason.code} at {self._moment():.1f} s: {self._reason.message}".strip()
        )
        return textwrap.shorten(
            words, 150, placeholder=" …"
        )  # longest reason under the title [characters]

    def _moment(self) -> float:
        """Return the time of the failure that ended the run [s]."""
        assert self._reason is not None
        return self._failed.get(self._reason.node_path, self._ended)

    def _mark_failure(self, axes: Any) -> None:
        if self._reason is not None:
            words = f"{self._reason.code}, {self._moment():.1f} s"
            axes.axvline(
                self._moment(), color=BAD, lw=1.4, label=words if len(axes.lines) > 1 else ""
            )

    def _draw_images(self, axes: Any) -> None:
        axes.set_axis_off()
        with_image = [view for view in self._images.values() if view.image is not None]
        if not with_image:
            return
        axes.imshow(with_image[-1].image)
        height, width = with_image[-1].image.shape[:2]  # type: ignore[union-attr]
        for view in self._images.values():
            for line in view.lines:
                points = np.vstack([line.points, line.points[:1]]) if line.closed else line.points
                axes.plot(
                    points[:, 0],
                    points[:, 1],
                    color=OVERLAY.get(line.style, OVERLAY["found"]),
                    lw=1.6,
                    label=line.label,
                )
            if view.points.size:
                axes.plot(view.points[:, 0], view.points[:, 1], "o", ms=3.5, color=OVERLAY["found"])
        axes.set_xlim(0, width)
        axes.set_ylim(height, 0)
        axes.set_title(
            "\n".join(v.caption for v in self._images.values() if v.caption), fontsize=8, loc="left"
        )

    def _draw_scene(self, axes: Any) -> None:
        from matplotlib.ticker import MaxNLocator

        for view in self._scenes.values():
            for points in view.points:
                axes.scatter(
                    *points.points.T,
                    s=6,
                    color=SCENE.get(points.style, INK),
                    label=points.label,
                    alpha=0.5,
                )
            for mesh in view.meshes:
                axes.plot_trisurf(
                    *mesh.vertices.T,
                    triangles=mesh.faces,
                    color=SCENE.get(mesh.style, INK),
                    lw=0,
                    alpha=0.9,
                )
            for line in view.lines:
                axes.plot(*line.points.T, color=SCENE.get(line.style, INK), lw=2, label=line.label)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_major_locator(MaxNLocator(4))  # more ticks run into each other
        axes.tick_params(labelsize=8)
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
        axes.set_zlabel("z [m]")
        axes.set_aspect("equal")
        captions = [view.caption for view in self._scenes.values() if view.caption]
        axes.set_title("\n".join(captions), fontsize=8, loc="left")

    def _by_unit(self) -> dict[str, list[tuple[str, NDArray[np.float64], NDArray[np.float64]]]]:
        """Return the samples of every quantity as (name, t, values), by unit: one axis for each unit."""
        units: dict[str, list[tuple[str, NDArray[np.float64], NDArray[np.float64]]]] = defaultdict(
            list
        )
        for views in self._series.values():
            for name in views[-1].values:
                having = [view for view in views if name in view.values]
                t = np.concatenate([view.t for view in having])
                values = np.concatenate([view.values[name] for view in having])
                unit = name[name.rfind("[") + 1 : name.rfind("]")] if "[" in name else ""
                units[unit].append((name, t, values))
        return units

    def _draw_series(
        self,
        axes: Any,
        unit: str,
        lines: list[tuple[str, NDArray[np.float64], NDArray[np.float64]]],
    ) -> None:
        axes.set_prop_cycle(color=SERIES)
        shown, scale = MILLI.get(unit, (unit, 1.0))
        for name, t, values in lines:
            t, values = _with_gaps(t, values)
            axes.plot(t, scale * values, lw=1.3, label=name.replace(f" [{unit}]", ""))
        thresholds = {
            k: v for views in self._series.values() for k, v in views[-1].thresholds.items()
        }
        axes.ticklabel_format(axis="y", useOffset=False)
        low, high = axes.get_ylim()
        if (
            missing := SMALLEST_SPAN.get(shown, 0.0) - (high - low)
        ) > 0.0:  # at rest: without its rounding errors
            low, high = axes.set_ylim(low - missing / 2, high + missing / 2)
        for number, (name, value) in enumerate(thresholds.items()):
            if f"[{unit}]" in name:
                words = f"{name.replace(f' [{unit}]', '')} {scale * value:.3g} {shown}"
                if (
                    1.5 * low - 0.5 * high < scale * value < 1.5 * high - 0.5 * low
                ):  # a distant line would flatten the curves
                    axes.axhline(
                        scale * value,
                        lw=0.9,
                        ls=("--", ":", "-.")[number % 3],
                        color=MUTED,
                        label=words,
                    )
                else:
                    axes.plot(
                        [], [], ls="none", label=f"{'↑' if scale * value > high else '↓'} {words}"
                    )
        kind = lines[0][0].partition(" [")[0] if len(lines) == 1 else KINDS.get(unit, "")
        self._mark_failure(axes)
        axes.set_ylabel(f"{kind}\n[{shown}]" if unit else kind, fontsize=9)
        axes.grid(alpha=0.25)
        if len(axes.get_legend_handles_labels()[1]) > 1:  # the axis names a single curve
            _legend(axes, place="upper left", beside=(1.005, 1.0))


def _has_drawings(view: ImageView) -> bool:
    return bool(view.lines) or bool(view.points.size)


def _with_gaps(
    t: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Insert NaN where samples are missing, so no line connects two grips."""
    apart = np.flatnonzero(np.diff(t) > GAP) + 1
    return np.insert(t, apart, np.nan), np.insert(values, apart, np.nan)


def _legend(
    axes: Any,
    where: Any = None,
    place: str = "upper right",
    beside: tuple[float, float] | None = None,
) -> None:
    """Draw the legend of `axes`: there, in other axes, or beside them."""
    handles, labels = axes.get_legend_handles_labels()
    named = {
        label: handle
        for handle, label in zip(handles, labels, strict=True)
        if label and label[0] != "_"
    }
    named = dict(list(named.items())[-8:])  # largest number of entries of a legend
    if named:
        (where or axes).legend(
            named.values(), named.keys(), fontsize=8, loc=place, bbox_to_anchor=beside
        )
