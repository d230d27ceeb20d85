"""The form of a fruit: its maps against numbers and against a mesh that was really deformed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from pomona.skills.perception.refinement.form import Form

BALL = trimesh.creation.icosphere(subdivisions=5, radius=0.05)


def test_cuboid_of_a_leaning_fruit_is_higher():
    upright = Form.scaled(BALL, 1.0)
    leaning = replace(upright, lean=np.array([0.05, 0.0]))
    assert upright.cuboid(BALL)[1] == pytest.approx([0.1, 0.1, 0.1], rel=1e-3)
    assert leaning.cuboid(BALL)[1][1] > 0.1


def test_nearly_round_models_are_known(apple):
    assert Form.scaled(apple, 1.0).nearly_round
    assert not Form.scaled(trimesh.creation.box((0.1, 0.05, 0.08)), 1.0).nearly_round
