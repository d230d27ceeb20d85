"""One size by several looks."""

import numpy as np
import pytest

from pomona.applications.inventory.fusion import SHARED, FusedSize, SizeOfLooks

R = np.eye(3)
QUARTER_TURN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def fuse_sizes(looks) -> FusedSize:
    size = SizeOfLooks()
    for each in looks:
        size.add(*each)
    return size.fused()


def look(size_mm, deviation_mm, axes=R):
    return np.array(size_mm) * 1e-3, np.diag((np.broadcast_to(deviation_mm, 3) * 1e-3) ** 2), axes


def test_a_single_look_stays_unchanged() -> None:
    size, covariance, _ = look([80, 70, 81], 2.0)
    fused = fuse_sizes([(size, covariance, R)])
    assert fused.dimensions == pytest.approx(size)
    assert fused.covariance == pytest.approx(covariance)
    assert (fused.looks, fused.agree) == (1, True)


def test_looks_are_weighted_by_their_information() -> None:
    fused = fuse_sizes([look([80, 70, 80], 1.0), look([85, 70, 80], 2.0)])
    assert fused.dimensions == pytest.approx([0.081, 0.070, 0.080])


def test_errors_that_looks_have_in_common_are_not_averaged_away() -> None:
    many = fuse_sizes([look([80, 70, 80], 2.0)] * 50)
    assert np.sqrt(np.diag(many.covariance)) == pytest.approx(
        2e-3 * np.sqrt(SHARED + (1 - SHARED) / 50)
    )


def test_correlated_errors_are_covered_by_the_interval() -> None:
    rng, errors, inside = np.random.default_rng(0), [], 0
    deviations = np.array([[1.0, 2.0, 1.5], [3.0, 1.0, 2.0], [2.0, 2.0, 2.0]]) * 1e-3
    truth = np.array([0.08, 0.07, 0.081])
    for _ in range(800):
        common = rng.normal(size=3)
        looks = [
            (
                truth + d * (np.sqrt(SHARED) * common + np.sqrt(1 - SHARED) * rng.normal(size=3)),
                np.diag(d**2),
                R,
            )
            for d in deviations
        ]
        fused = fuse_sizes(looks)
        errors.append((fused.dimensions - truth) / np.sqrt(np.diag(fused.covariance)))
        inside += fused.agree
    assert np.std(errors, axis=0) == pytest.approx(1.0, abs=0.08)
    assert inside == 800  # as if they had nothing in common, they would agree in 99 of 100 cases


def test_looks_that_disagree_are_reported_and_widen_the_interval() -> None:
    apart, near = ([look([80, 70, 80], 1.0), look([80 + by, 70, 80], 1.0)] for by in (12.0, 1.0))
    assert fuse_sizes(near).agree
    assert not fuse_sizes(apart).agree
    assert np.all(
        np.diag(fuse_sizes(apart).covariance) > 5.0 * np.diag(fuse_sizes(near).covariance)
    )


def test_a_look_from_the_side_has_its_level_axes_exchanged() -> None:
    fused = fuse_sizes([look([80, 70, 60], 1.0), look([60, 70, 80], 1.0, QUARTER_TURN)])
    assert fused.dimensions == pytest.approx([0.080, 0.070, 0.060])
    assert fused.agree
