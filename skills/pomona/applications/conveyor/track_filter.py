"""Where a fruit on a belt is and will be: a Kalman filter with constant velocity and the look's bias as a state.

A fit of a fruit's place errs twice: by 0.1 mm at random, and by a bias of a millimetre that changes with the view.
With white noise alone the filter would be far too sure of the velocity; with the bias as a state that is forgotten
within a second its ellipses hold. The encoder moves the place; the velocity is then the fruit's own, over the belt.

The state is place, velocity over the belt and bias, shape (9,), in the belt's frame: x with the travel, z up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive import Float64, ReadOnly

SIGMA = 1e-4  # random error of one fit in each direction [m]
BIAS = 6e-4
BIAS_TIME = 0.9
"""Deviation of the bias in each direction [m], and the time in which it is forgotten [s]: it then walks by 0.8 mm a
root second, the best of the probe's filters."""
FIRST = 3e-4  # random error of a fruit's first measurement in each direction [m]: its shape is not known yet


@dataclass(frozen=True, slots=True)
class MotionModel:
    """How a fruit may move over the belt: deviations of its velocity at first, shape (3,) [m/s], and the spectral
    density of its acceleration [m/s²/√Hz]; none of them upwards."""

    velocity: tuple[float, float]
    wander: float


FREE = MotionModel(
    (0.5, 0.05), 3e-3
)  # rests on a belt without an encoder: the velocity is the belt's, and unknown
CARRIED = MotionModel((1e-3, 1e-3), 3e-4)
"""Rests on a belt with an encoder: the velocity over the belt is the error of the encoder."""
ROLLING = MotionModel((0.5, 0.3), 0.3)  # rolls on the belt: an apple wobbles


@dataclass(frozen=True, slots=True, eq=False)
class FruitState(ReadOnly):
    """State of a filter at a time: `t` [s], `x` shape (9,), `P` shape (9, 9), and the belt's travel then [m]."""

    t: float
    travelled: float
    x: Float64
    P: Float64

    @property
    def place(self) -> Float64:
        """In the belt's frame, shape (3,) [m]."""
        return self.x[:3]

    @property
    def velocity(self) -> Float64:
        """Over the belt, shape (3,) [m/s]."""
        return self.x[3:6]

    @property
    def place_covariance(self) -> Float64:
        """Shape (3, 3) [m²]."""
        return self.P[:3, :3]


def begin(t: float, travelled: float, place: Float64, model: MotionModel) -> FruitState:
    """Return the state after a fruit's first measurement; `place` in the belt's frame, shape (3,) [m]."""
    deviations = np.array([np.hypot(FIRST, BIAS)] * 3 + [*model.velocity, 1e-5] + [BIAS] * 3)
    P = np.diag(deviations**2)
    P[:3, 6:] = P[6:, :3] = -(BIAS**2) * np.eye(3)  # the place is the measurement less its bias
    return FruitState(t, travelled, np.concatenate([place, np.zeros(6)]), P)


def predict(state: FruitState, t: float, travelled: float, model: MotionModel) -> FruitState:
    """Return the state at another time [s], when the belt has travelled so far [m]."""
    dt = t - state.t
    keeps = float(np.exp(-abs(dt) / BIAS_TIME))
    F = np.eye(9)
    F[:3, 3:6] = dt * np.eye(3)
    F[6:, 6:] *= keeps
    x = F @ state.x
    x[0] += travelled - state.travelled
    Q = np.zeros((9, 9))
    d = abs(dt)
    level = model.wander**2 * np.diag([1.0, 1.0, 0.0])
    Q[:3, :3], Q[:3, 3:6], Q[3:6, :3], Q[3:6, 3:6] = (
        level * d**3 / 3.0, level * d * dt / 2.0, level * d * dt / 2.0, level * d,
    )  # fmt: skip
    Q[6:, 6:] = BIAS**2 * (1.0 - keeps**2) * np.eye(3)
    return FruitState(t, travelled, x, F @ state.P @ F.T + Q)


def update(predicted: FruitState, place: Float64) -> tuple[FruitState, float, float]:
    """Return the state with a measured place at its time, shape (3,) [m], the innovation's square, and its likelihood.

    The square is that of the innovation over its deviation (NIS): 3 on average, if the model holds. The likelihood is
    its logarithm, to compare models.
    """
    H = np.concatenate([np.eye(3), np.zeros((3, 3)), np.eye(3)], axis=1)
    S = H @ predicted.P @ H.T + SIGMA**2 * np.eye(3)
    innovation = place - H @ predicted.x
    square = float(innovation @ np.linalg.solve(S, innovation))
    gain = np.linalg.solve(S, H @ predicted.P).T
    keeps = np.eye(9) - gain @ H
    P = keeps @ predicted.P @ keeps.T + SIGMA**2 * gain @ gain.T
    likelihood = -0.5 * (square + float(np.linalg.slogdet(S)[1]))
    return (
        FruitState(predicted.t, predicted.travelled, predicted.x + gain @ innovation, P),
        square,
        likelihood,
    )
