"""The observer and its answer over arrays of samples, from rest, as the grip controller steps them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.observer import (
    DynamicSettings,
    ObserverSettings,
    answer_slip,
    observe,
    steps_in_a_sample,
)


def observe_slip(
    y: ArrayLike, g: ArrayLike, J: ArrayLike, settings: ObserverSettings, rate: float = 500.0
) -> Float64:
    """Return the estimated slip velocity for arrays of samples, from rest under the first one.

    Args:
        y: generalised torque, shape (n,) [N·m].
        g: largest friction torque, shape (n,) or a number [N·m].
        J: inertia about the centre of rotation, shape (n,) or a number [kg·m²].
        rate: samples per second [Hz].

    Returns:
        omega after each sample, shape (n,) [rad/s].
    """
    substeps = steps_in_a_sample(rate)
    samples = np.stack(np.broadcast_arrays(y, g, J), axis=-1).tolist()
    omega, z, result = 0.0, samples[0][0] / settings.sigma0, []
    for sample in samples:
        for _ in range(substeps):
            omega, z = observe(omega, z, *sample, settings, 1.0 / rate / substeps)
        result.append(omega)
    return np.array(result)


def dynamic_force(omega: ArrayLike, settings: DynamicSettings, rate: float = 500.0) -> Float64:
    """Return f_nd [N], shape (n,), for slip velocities [rad/s] that are held over each sample of `rate`, from rest."""
    substeps = steps_in_a_sample(rate)
    integral, before, result = 0.0, 0.0, []
    for velocity in np.asarray(omega, np.float64).tolist():
        for _ in range(substeps):
            integral, force = answer_slip(
                integral, before, velocity, settings, 1.0 / rate / substeps
            )
            before = velocity
        result.append(force)
    return np.array(result)
