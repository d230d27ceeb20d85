"""Prior distribution of the sizes of a kind of fruit, and its estimation.

A depth camera measures the apparent size of a fruit well, but hardly its proportions. So the width W and height H of a
fruit are the kind's, improved by the width of the scaled model:

    ln W ~ N(ln width, width_deviation²),  ln H - ln W ~ N(ln height_over_width, height_over_width_deviation²)
    ln shown = ln W + ½ s² · (ln H - ln W - ln model's) + ln looks + error,  error ~ N(0, looks_deviation² + deviation²)

s is the sine between the line of sight and the stem's axis: from the side the outline is W wide and H high, along the
axis it is W both ways, and the scaled model's size is their geometric mean. All is linear in the logarithms, so the
posterior is exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64

LEAST_FRUIT = 6  # minimum number of fruit for the spread of a kind's sizes


class TooFewFruit(ValueError):
    """Not enough measured fruit to learn a kind's sizes from."""


@dataclass(frozen=True, slots=True)
class KindSizes:
    """Sizes of a kind of fruit; every deviation is of a logarithm, and thus relative."""

    width: float  # width, width_deviation: median of the horizontal dimension [m] and its spread
    width_deviation: float
    height_over_width: float  # height_over_width, height_over_width_deviation: median of the proportion and its spread
    height_over_width_deviation: float
    # looks, looks_deviation: width of a scaled model over the true one, and its spread beyond the uncertainty of each
    # measurement
    looks: float = 1.0
    looks_deviation: float = 0.0

    def given(
        self, shown: float, deviation: float, sine: float, model_height_over_width: float
    ) -> tuple[Float64, Float64]:
        """Return width and height, (2,) [m], and covariance, (2, 2), of a fruit whose scaled model is `shown` wide.

        `deviation` is that of ln shown, `sine` of the angle between the line of sight and the stem's axis.
        """
        mean = np.log([self.width, self.height_over_width])
        prior = np.diag([self.width_deviation**2, self.height_over_width_deviation**2])
        row = np.array([1.0, 0.5 * sine**2])
        expected = row @ mean - row[1] * math.log(model_height_over_width) + math.log(self.looks)
        gain = prior @ row / (row @ prior @ row + self.looks_deviation**2 + deviation**2)
        ln_width, ln_ratio = mean + gain * (math.log(shown) - expected)
        covariance = prior - np.outer(gain, row @ prior)
        size: Float64 = np.exp([ln_width, ln_width + ln_ratio])
        to_size = size[:, np.newaxis] * np.array([[1.0, 0.0], [1.0, 1.0]])
        return size, to_size @ covariance @ to_size.T


def learn_sizes(
    sizes: Float64,
    shown: Float64,
    deviations: Float64,
    sines: Float64,
    model_height_over_width: float,
) -> KindSizes:
    """Estimate a kind's sizes from fruit measured by hand, and seen by the camera.

    Args:
        sizes, shown: widths and heights, (n, 2), and width of the scaled model, (n,) [m].
        deviations, sines: of ln shown, and of the angle between line of sight and stem axis, (n,).

    Raises TooFewFruit: fewer than `LEAST_FRUIT`, or a size that is none.
    """
    if len(sizes) < LEAST_FRUIT:
        raise TooFewFruit(
            f"{len(sizes)} measured fruit do not give the spread of sizes: measure {LEAST_FRUIT} or more"
        )
    if not (
        np.isfinite(sizes).all()
        and (sizes > 0.0).all()
        and np.isfinite(shown).all()
        and (shown > 0.0).all()
    ):
        raise TooFewFruit("a size must be a positive number: leave its fruit out")
    ln_width = np.log(sizes[:, 0])
    ln_ratio = np.log(sizes[:, 1] / sizes[:, 0])
    seen = (
        np.log(shown) - ln_width - 0.5 * sines**2 * (ln_ratio - math.log(model_height_over_width))
    )
    # measurements that know better than this share how large a fruit looks count no more for it
    weight = 1.0 / (deviations**2 + 0.03**2)
    looks = float(weight @ seen / weight.sum())
    beyond = float(weight @ ((seen - looks) ** 2 - deviations**2) / weight.sum())
    wider = math.sqrt(1.0 + 1.0 / len(sizes))  # uncertainty of the medians of this number of fruit
    spread = np.var([ln_width, ln_ratio], axis=1, ddof=1)
    # no fruit of one kind are more alike than this share
    width_deviation, ratio_deviation = wider * np.sqrt(np.maximum(spread, 0.01**2))
    return KindSizes(
        width=float(np.exp(ln_width.mean())),
        width_deviation=float(width_deviation),
        height_over_width=float(np.exp(ln_ratio.mean())),
        height_over_width_deviation=float(ratio_deviation),
        looks=math.exp(looks),
        looks_deviation=wider * math.sqrt(max(beyond, 0.0)),
    )


def held_out(
    sizes: Float64,
    shown: Float64,
    deviations: Float64,
    sines: Float64,
    model_height_over_width: float,
) -> Float64:
    """Return the errors of width and height of each fruit with the sizes of all others, shape (n, 2) [m].

    The arguments are those of `learn_sizes`. Raises TooFewFruit: without one of them there are fewer than
    `LEAST_FRUIT`.
    """
    errors = np.empty(sizes.shape)
    for i in range(len(sizes)):
        others = np.arange(len(sizes)) != i
        kind = learn_sizes(
            sizes[others], shown[others], deviations[others], sines[others], model_height_over_width
        )
        found, _ = kind.given(
            float(shown[i]), float(deviations[i]), float(sines[i]), model_height_over_width
        )
        errors[i] = found - sizes[i]
    return errors
