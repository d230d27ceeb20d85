"""Trees: leaves hide fruit, never all of it everywhere; the truth follows the visible part."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.tools.training.foliage import SPRAYS, add_far_fruit, spray
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.paint import skins
from pomona.tools.training.scene import render_scene


def seen(kinds: tuple[float, float, float, float], frames: int = 12) -> np.ndarray:
    """Visibility of all fruit of some frames."""
    options = SceneOptions(
        width=320, height=240, camera=(305.3, 305.3, 158.6, 118.8), kinds=kinds, distractors=0
    )
    fruit = load_fruit("apple")
    return np.array(
        [t.visibility for seed in range(frames) for t in render_scene(fruit, options, seed).fruit]
    )


@pytest.mark.slow
def test_leaves_hide_fruit_in_part() -> None:
    among_few, on_tree = seen((0.0, 0.0, 1.0, 0.0)), seen((0.0, 0.0, 0.0, 1.0))
    assert np.mean(on_tree >= 0.6) < np.mean(among_few >= 0.6) - 0.1
    assert np.mean((on_tree > 0.1) & (on_tree < 0.9)) > 0.3
    assert np.mean(on_tree >= 0.85) > 0.1


@given(st.integers(0, SPRAYS - 1))
def test_a_spray_springs_from_its_root(index: int) -> None:
    shape = spray(index)
    reach = np.linalg.norm(shape.vertices, axis=1)
    assert 0.5 < reach.max() < 2.5
    assert reach.min() < 1.0
    assert np.isfinite(shape.normals).all()
    assert shape.two_sided
    assert shape.faces.max() < len(shape.vertices)


def test_far_fruit_stays_small() -> None:
    apple: FruitModel = load_fruit("apple")
    picture = np.zeros((240, 320, 3), np.float32)
    add_far_fruit(picture, skins(apple), np.random.default_rng(3))
    assert 0.0 < np.mean(picture.max(axis=2) > 0.0) < 0.15
