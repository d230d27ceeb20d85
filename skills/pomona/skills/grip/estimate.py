"""The estimate of a grip, sample by sample: `Estimator` keeps the constants and the last `GripEstimate`."""

from __future__ import annotations

import math

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.estimate_kernel import (
    Allowance,
    GripEstimate,
    GripModel,
    NoiseModel,
    Rates,
    estimate_sample,
)
from pomona.skills.grip.limit_surface import SoftContact, surface_table
from pomona.skills.grip.observer import steps_in_a_sample
from pomona.skills.grip.pads import MIRROR
from pomona.skills.grip.settings import GripSettings


class Estimator:
    """Makes a `GripEstimate` of each sample. Usable alone: `calibrate`, then `advance` with raw wrenches.

    Attributes:
        estimate: the newest one; all zero before the first sample.
    """

    def __init__(self, settings: GripSettings) -> None:
        self._filters = settings.filters
        self._model = _model_of(settings)
        self.estimate = GripEstimate()

    @property
    def bias(self) -> Float64:
        """Reading of the fingers with nothing between them, shape (2, 6) [N, N·m]."""
        return self._model.noise.bias

    def calibrate(self, samples: Float64) -> None:
        """Learn bias and noise from samples with nothing touching, shape (n, 2, 6)."""
        rates, share = self._model.rates, self._filters.noise_stds
        right = MIRROR * samples[:, 1]
        modes = 0.5 * np.stack([samples[:, 0] + right, samples[:, 0] - right], axis=1)
        fast_std = math.sqrt(rates.fast / (2.0 - rates.fast))
        variance = modes.var(axis=0).sum(axis=0) * rates.load / (2.0 - rates.load)
        apart = float(modes[:, 1, 2].var()) * rates.normal / (2.0 - rates.normal)
        of_mean = samples.var(axis=0).sum(axis=0) / len(samples)
        normal_variance = float(modes[:, :, 2].var(axis=0).sum()) * rates.normal / (2.0 - rates.normal)
        noise = NoiseModel(
            bias=samples.mean(axis=0),
            band=share * modes.std(axis=0) * fast_std,
            variance=variance,
            difference_variance=4.0 * apart,
            f_n_band=4.0 * math.sqrt(normal_variance),
            bias_std=math.sqrt(float(of_mean[2] + 0.5 * (of_mean[0] + of_mean[1]) / self._model.friction.mu**2)),
            push=self._filters.push_stds * math.sqrt(float(variance[0] + variance[1])),
        )
        self._model = self._model._replace(noise=noise)
        self.estimate = GripEstimate(f_n_band=noise.f_n_band, bias_std=noise.bias_std)

    def set_friction(self, contact: SoftContact) -> None:
        """Use another friction from the next sample on."""
        self._model = self._model._replace(friction=surface_table(contact))

    def restart_observer(self) -> None:
        """Start the slip observer at rest under the load of the next sample."""
        memory = self.estimate.memory._replace(is_started=False)
        self.estimate = self.estimate._replace(memory=memory)

    def advance(self, raw: Float64, periods: int = 1, expected: float = 0.0, is_carried: bool = False) -> GripEstimate:
        """Take one raw sample; the arguments are those of `estimate_sample`."""
        self.estimate = estimate_sample(self.estimate.memory, raw, periods, expected, is_carried, *self._model)
        return self.estimate


def _model_of(settings: GripSettings) -> GripModel:
    filters, period = settings.filters, 1.0 / settings.rate
    substeps = steps_in_a_sample(settings.rate)

    def weight(lag: float) -> float:
        return 1.0 - math.exp(-1.0 / (settings.rate * lag))

    return GripModel(
        noise=NoiseModel(np.zeros((2, 6)), np.zeros((2, 6)), np.zeros(6), *(0.0,) * 4),
        rates=Rates(
            fast=weight(filters.fast_lag),
            normal=weight(filters.normal_lag),
            load=weight(filters.load_lag),
            centre=weight(filters.centre_lag),
            rise=weight(filters.rise_lag),
            calm=weight(filters.calm_lag),
            period=period,
            substeps=substeps,
            step=period / substeps,
        ),
        friction=surface_table(settings.contact),
        filters=filters,
        observer=settings.observer,
        dynamic=settings.dynamic,
        allowance=Allowance(settings.offset, settings.reserve),
    )
