"""Cutting a depth image at its steps."""

from __future__ import annotations

import numpy as np

from pomona.skills.perception.refinement.segment import connected_to

SHAPE = (60, 60)


def scene():
    """A fruit-like bump in the middle, a leaf 30 mm nearer over its left third, the ground behind."""
    v, u = np.indices(SHAPE)
    apart = np.hypot(u - 30, v - 30)
    bump = apart < 20
    depth = np.where(bump, 0.60 + 2e-5 * apart**2, 0.70)
    leaf = (u > 2) & (u < 22) & (v > 20) & (v < 40)
    return np.where(leaf, 0.57, depth), bump, leaf


def test_agreeing_points_are_kept_and_the_leaf_is_cut_off():
    depth, bump, leaf = scene()
    agreeing = bump & ~leaf
    agreeing[20:24, 20:24] = True  # a few pixels of the leaf agree by chance
    chosen = connected_to(agreeing, depth, covered=bump)
    assert not chosen[leaf].any()
    assert not chosen[~bump].any()
    assert chosen[bump & ~leaf].mean() > 0.85


def test_things_in_front_keep_their_outline():
    depth, bump, leaf = scene()
    chosen = connected_to(leaf & bump, depth, covered=bump)
    assert np.array_equal(chosen, leaf)


def test_holes_part_surfaces():
    depth, bump, _ = scene()
    depth = np.where(bump, depth, 0.0)
    depth[:, 30] = np.nan
    right_half = bump & (np.indices(SHAPE)[1] > 30)
    chosen = connected_to(right_half, depth, covered=bump)
    assert np.array_equal(chosen, right_half)


def test_nothing_agrees():
    depth, bump, _ = scene()
    assert not connected_to(np.zeros(SHAPE, bool), depth, covered=bump).any()
