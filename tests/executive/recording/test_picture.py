"""The picture of a run: nothing in it is cut off, nothing lies on something else, every axis has its unit."""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import matplotlib.figure
import matplotlib.legend
import numpy as np
import pytest

from pomona.executive.reasons import Reason
from pomona.executive.recording.picture import Picture
from pomona.executive.running.events import Event, NodeChanged, Published, RunEnded, RunStarted
from pomona.executive.views import ImageView, Line2, Line3, Points3, SceneView, SeriesView


def plotted(
    monkeypatch: pytest.MonkeyPatch, views: list[tuple[str, Any]], events: Sequence[Event] = ()
) -> Any:
    """The figure of these views, in this order, and of other events of the run."""
    figures: list[Any] = []
    monkeypatch.setattr(
        matplotlib.figure.Figure, "savefig", lambda figure, *_a, **_k: figures.append(figure)
    )
    picture = Picture()
    for topic, view in views:
        picture.on_event(Published(0.0, 0, "t", topic, view))
    for event in events:
        picture.on_event(event)
    picture.save(io.BytesIO(), "pick_apple: success, seed 3")
    return figures[0]


def drawn(monkeypatch: pytest.MonkeyPatch, peak: float, long: str) -> Any:
    """The figure of a run with a look, a scene and a grip whose force goes up to `peak` [N]."""
    t = np.linspace(0.0, 5.0, 50)
    square = np.array([[10.0, 10.0], [200.0, 10.0], [200.0, 200.0]])
    corners = np.array([[0.3, -0.5, -0.15], [-0.1, -0.4, 0.4]])
    views = {
        "detection": ImageView(
            np.zeros((480, 640, 3), np.uint8), (Line2(square, "this line", "found"),), caption=long
        ),
        "measured": ImageView(None, (Line2(square, "measured", "refined"),), caption=long),
        "map": SceneView(points=(Points3(corners, label="hidden behind obstacles"),), caption=long),
        "path": SceneView(lines=(Line3(corners, "planned path", "path"),), caption=long),
        "grip": SeriesView(
            t,
            {
                "grasp force [N]": peak * np.sin(t) ** 2,
                "minimum grip force [N]": 0.8 * peak * np.sin(t) ** 2,
                "slip speed [m/s]": 1e-3 * np.sin(t) ** 2,
                "width [m]": 0.08 + 0.01 * t,
            },
            {"force limit [N]": 14.0, "no bruise below [N]": 29.7},
        ),
    }
    figure = plotted(monkeypatch, list(views.items()))
    figure.canvas.draw()
    return figure


@pytest.mark.parametrize(
    ("peak", "long"), [(9.0, "1 found"), (140.0, "grasp 6: θ 0°, α 180°, 103 mm open, 29 mm clear")]
)
def test_texts_are_inside_the_picture_and_none_lies_on_another(
    peak: float, long: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure = drawn(monkeypatch, peak, long)
    texts = {"title": figure._suptitle}
    legends = {}
    for number, axes in enumerate(figure.axes):
        texts |= {f"{number} above": axes._left_title}
        if axes.axison:
            texts |= {f"{number} {name}": axis.label for name, axis in axes._axis_map.items()}
        shown = [
            child for child in axes.get_children() if isinstance(child, matplotlib.legend.Legend)
        ]
        legends |= {f"{number} legend {place}": legend for place, legend in enumerate(shown)}
    assert (
        legends["1 legend 0"].get_window_extent().x0 > figure.axes[0].bbox.x1
    )  # beside the image, not on the fruit
    places = {
        name: text.get_window_extent()
        for name, text in (texts | legends).items()
        if name in legends or text.get_text()
    }
    assert len(places) >= 10
    whole = figure.bbox
    out = [
        name
        for name, box in places.items()
        if box.x0 < 0 or box.y0 < 0 or box.x1 > whole.x1 or box.y1 > whole.y1
    ]
    assert out == []
    assert [
        pair for pair in combinations(places, 2) if places[pair[0]].overlaps(places[pair[1]])
    ] == []
    scene = next(axes for axes in figure.axes if axes.name == "3d")
    assert not any(legend.get_window_extent().overlaps(scene.bbox) for legend in legends.values())


def test_every_axis_has_its_unit_and_slip_is_in_millimetres_a_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    figure = drawn(monkeypatch, 9.0, "1 found")
    labels = [
        text
        for axes in figure.axes
        if axes.axison
        for text in (axes.get_xlabel(), axes.get_ylabel())
    ]
    assert all(label.endswith("]") for label in labels if label)
    assert {"slip speed\n[mm/s]", "force\n[N]", "width\n[mm]", "time [s]"} <= set(labels)
    force = next(axes for axes in figure.axes if axes.get_ylabel() == "force\n[N]")
    assert "↑ no bruise below 29.7 N" in [
        text.get_text() for text in force.get_legend().get_texts()
    ]


def test_no_line_goes_from_one_grip_to_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.array([0.0, 0.1, 0.2])
    grips = [
        ("grip", SeriesView(begin + t, {"grasp force [N]": np.array([1.0, 2.0, 3.0])}))
        for begin in (0.0, 9.0)
    ]
    figure = plotted(monkeypatch, [*grips])
    (curve,) = figure.axes[-1].lines
    assert np.isnan(curve.get_ydata()).tolist() == [False] * 3 + [True] + [False] * 3


def test_one_look_is_shown_the_last_that_had_something_to_draw(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def look(brightness: int, caption: str, *lines: Line2) -> ImageView:
        return ImageView(np.full((48, 64, 3), brightness, np.uint8), lines, caption=caption)

    line = Line2(np.array([[1.0, 1.0], [9.0, 9.0]]), "a line", "found")
    looks = [
        ("detection", look(1, "first", line)),
        ("measured", look(1, "first measured", line)),
        ("detection", look(2, "second", line)),
        ("grasp", ImageView(None, (line,), caption="second grasp")),
        ("detection", look(3, "nothing found")),
    ]
    axes = plotted(monkeypatch, looks).axes[0]
    assert axes.images[0].get_array().max() == 2
    assert axes.get_title("left").split("\n") == ["second", "second grasp"]
    axes = plotted(monkeypatch, looks[-1:]).axes[0]
    assert axes.get_title("left") == "nothing found"


def test_a_failure_has_its_reason_above_and_its_moment_in_all_curves_at_one_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    t = np.linspace(0.0, 5.0, 50)
    slipped = Reason("root/lift", "SLIPPED", "the fruit has slipped out of the fingers")
    again = Reason("root", "SLIPPED", "the fruit has slipped out of the fingers", causes=(slipped,))
    node = {"path": "root/lift", "parent": "root", "name": "Lift"}
    events = [
        RunStarted(
            0.0, 0, "r", "t", "t.yaml", "", "", "c", "mock", "", "", 0, {}, (node,), {}, 0.0, 0.02
        ),
        Published(
            0.0,
            0,
            "root/lift",
            "grip",
            SeriesView(t, {"force [N]": t, "load [N]": t, "width [m]": t}),
        ),
        NodeChanged(1.2, 60, "root/lift", "FAILURE", "", 1, slipped),
        NodeChanged(3.6, 180, "root/lift", "FAILURE", "", 2, slipped),
        RunEnded(5.0, 250, "failure", again, 250, 5.0, 5.0, None),
    ]
    figure = plotted(monkeypatch, [], events)
    assert [text.get_text() for text in figure.texts if "SLIPPED" in text.get_text()] == [
        "Lift SLIPPED at 3.6 s: the fruit has slipped out of the fingers"
    ]
    figure.canvas.draw()
    marks = [
        line for axes in figure.axes for line in axes.lines if list(line.get_xdata()) == [3.6, 3.6]
    ]
    assert len(marks) == 2
    assert len({mark.get_window_extent().x0 for mark in marks}) == 1


def test_curves_at_rest_show_no_rounding_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.linspace(0.0, 0.1, 10)
    rest = SeriesView(t, {"grasp force [N]": 0.0 * t, "width [m]": 0.103 + 1e-8 * t})
    for axes in (axes for axes in plotted(monkeypatch, [("grip", rest)]).axes if axes.lines):
        low, high = axes.get_ylim()
        assert high - low == pytest.approx(1.0)
        axes.figure.canvas.draw()
        assert axes.yaxis.get_major_formatter().get_offset() == ""


def test_a_run_without_pictures_gives_their_room_to_the_curves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    t = np.linspace(0.0, 5.0, 50)
    curves = (
        "grip",
        SeriesView(t, {"grasp force [N]": 9.0 * np.sin(t)}, {"force limit [N]": 140.0}),
    )
    emptied = ("belt", SceneView(caption="the fruit was taken from its place"))
    figure = plotted(monkeypatch, [emptied, curves])
    figure.canvas.draw()
    assert [axes for axes in figure.axes if axes.name == "3d"] == []
    shown = [axes for axes in figure.axes if axes.axison]
    assert len(shown) == 1
    assert shown[0].get_position().height > 0.7
    texts = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert texts == []
    assert "↑ force limit 140 N" in [text.get_text() for text in shown[0].get_legend().get_texts()]


def test_a_scene_without_an_image_is_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = np.array([[0.3, -0.5, -0.15], [-0.1, -0.4, 0.4]])
    views = [("belt", SceneView(lines=(Line3(corners, "belt", "muted"),)))]
    scene = next(axes for axes in plotted(monkeypatch, views).axes if axes.name == "3d")
    assert scene.get_position().width > 0.45
