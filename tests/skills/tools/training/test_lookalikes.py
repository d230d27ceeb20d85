"""Things that may be taken for an apple, in scenes with and without one."""

import numpy as np
import pytest

from pomona.skills.perception.fruit import load_fruit
from pomona.tools.training.lookalikes import draw_lookalike
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.scene import render_scene

SMALL = SceneOptions(
    width=160, height=120, camera=(152.6, 152.6, 79.0, 59.2), kinds=(1.0, 0.0, 0.0, 0.0)
)


def test_they_are_as_large_as_things_on_a_table_and_painted_within_bounds() -> None:
    extents = []
    for seed in range(60):
        thing = draw_lookalike(np.random.default_rng(seed))
        points = thing.shape.vertices * thing.scale
        extents.append(float(np.ptp(points, axis=0).min()))
        assert thing.paint.shape == thing.shape.vertices.shape
        assert np.isfinite(points).all()
        assert 0.0 <= thing.paint.min() <= thing.paint.max() < 3.0  # light, not yet a picture
    assert 0.01 < min(extents) < 0.04 < max(extents) < 0.2


def test_a_scene_without_fruit_labels_everything_as_no_fruit() -> None:
    options = SceneOptions(
        SMALL.width, SMALL.height, SMALL.camera, (0, 0), 0, kinds=SMALL.kinds, lookalikes=8
    )
    apple = load_fruit("apple")
    frames = [render_scene(apple, options, seed) for seed in range(2)]
    assert not any(frame.fruit for frame in frames)
    assert sum(len(frame.decoys) for frame in frames) >= 4
    assert np.array_equal(frames[1].colour, render_scene(apple, options, 1).colour)


@pytest.mark.parametrize("lookalikes", [0, 6])
def test_fruit_is_the_same_whether_anything_stands_beside_it(lookalikes: int) -> None:
    apple = load_fruit("apple")
    alone = render_scene(apple, SMALL, 11)
    beside = render_scene(apple, SceneOptions(*SMALL_WITHOUT_LOOKALIKES, lookalikes=lookalikes), 11)
    assert [truth.dimensions.tolist() for truth in beside.fruit] == [
        t.dimensions.tolist() for t in alone.fruit
    ]


SMALL_WITHOUT_LOOKALIKES = (
    SMALL.width, SMALL.height, SMALL.camera, SMALL.instances, SMALL.distractors, SMALL.scale, SMALL.height_ratio,
    SMALL.exact, SMALL.kinds,
)  # fmt: skip
