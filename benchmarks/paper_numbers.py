"""The tables of the paper as printed (Costanzo et al., Enhanced 6D Pose Estimation for Robotic Fruit Picking, 2023).

All lengths in metres. Positions stand on the table's surface, z up; apples in order 1 … 5, attempts in order 1 … 5.
"""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64

CAD_DEPLOYED: Float64 = np.array([0.09756, 0.08539, 0.09590])
"""Dimensions of the model that the authors published; mu times this gives their printed dimensions."""

APPLES: Float64 = np.array(
    [
        [0.089, 0.081, 0.089],
        [0.091, 0.085, 0.091],
        [0.093, 0.073, 0.093],
        [0.073, 0.064, 0.073],
        [0.062, 0.047, 0.062],
    ]
)

REFINED_POSITION: Float64 = np.array(
    [
        [-0.026, -0.525, 0.045],
        [-0.042, -0.519, 0.041],
        [-0.035, -0.521, 0.031],
        [-0.028, -0.520, 0.024],
        [-0.031, -0.526, 0.011],
    ]
)
REFINED_CENTROID_ERROR: Float64 = np.array([-0.009, -0.001, 0.0058, 0.0014, 0.012])
REFINED_DIMENSIONS: Float64 = np.array(
    [
        [0.091, 0.079, 0.089],
        [0.087, 0.077, 0.086],
        [0.097, 0.084, 0.095],
        [0.074, 0.065, 0.073],
        [0.063, 0.055, 0.062],
    ]
)
REFINED_DIMENSION_ERROR: Float64 = np.array([0.002, 0.005, 0.002, 0.008, 0.0081])
MU_OPT: Float64 = np.array([0.928, 0.897, 0.995, 0.763, 0.648])

UNREFINED_POSITION: Float64 = np.array(
    [
        [-0.026, -0.532, 0.002],
        [-0.045, -0.535, -0.029],
        [-0.035, -0.522, 0.029],
        [-0.034, -0.564, -0.172],
        [-0.028, -0.617, -0.349],
    ]
)
UNREFINED_CENTROID_ERROR: Float64 = np.array([0.038, 0.013, 0.007, 0.203, 0.372])

REFINED_SUCCESS: Float64 = np.array(
    [
        [1.00, 1.00, 1.00, 1.00, 1.00],
        [1.00, 1.00, 1.00, 1.00, 1.00],
        [0.66, 0.66, 1.00, 1.00, 1.00],
        [0.66, 1.00, 1.00, 1.00, 1.00],
        [0.66, 0.33, 0.66, 0.66, 0.66],
    ]
)
UNREFINED_SUCCESS: Float64 = np.array(
    [
        [1.00, 0.66, 0.00, 1.00, 1.00],
        [0.33, 0.33, 0.33, 0.00, 0.00],
        [0.66, 0.33, 0.33, 0.33, 0.33],
        [0.00, 0.00, 0.00, 0.00, 0.00],
        [0.00, 0.00, 0.00, 0.00, 0.00],
    ]
)
REPETITIONS = 3


def centroid_errors(positions: Float64) -> Float64:
    """The paper's centroid error from its own positions: half the apple's height less the estimated z, shape (5,)."""
    errors: Float64 = APPLES[:, 1] / 2.0 - positions[:, 2]
    return errors


def dimension_errors(dimensions: Float64) -> Float64:
    """The paper's dimensional error from its own dimensions: the norm of the difference, shape (5,)."""
    errors: Float64 = np.linalg.norm(dimensions - APPLES, axis=1)
    return errors
