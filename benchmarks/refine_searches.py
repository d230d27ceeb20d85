"""The paper's method with other optimisers than the one that suits it best.

The paper names "a standard deterministic constrained optimization algorithm with bounds". Our reference uses Brent's
bounded search of one variable, which needs the fewest renders by far; this compares the bounded methods of
`scipy.optimize.minimize`, L-BFGS-B being its choice where none is named. Steps of difference quotients are as small as
the depth buffer's single precision allows.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.fruit import FruitModel
from pomona.skills.perception.refinement.render import (
    DepthImage,
    ImageBox,
    RendererName,
    render_depth,
)
from pomona.skills.perception.refinement.scale_fit import (
    line_inliers,
    moved_and_scaled,
    sigma_bound,
)

SEARCHES: dict[str, dict[str, float]] = {
    "L-BFGS-B": {"eps": 1e-3, "ftol": 1e-14, "gtol": 1e-9},
    "SLSQP": {"eps": 1e-3, "ftol": 1e-12},
    "trust-constr": {"xtol": 1e-5, "finite_diff_rel_step": 1e-3},
    "COBYLA": {"rhobeg": 0.25, "tol": 1e-5},
    "Powell": {"xtol": 1e-5},
    "Nelder-Mead": {"xatol": 1e-5, "fatol": 1e-12},
}
"""Options for sigma as a share of its bound, to about 5 µm, and for an objective in mm²."""


def search(
    name: str,
    depth: DepthImage,
    fruit: FruitModel,
    T: Float64,
    camera: Intrinsics,
    using: RendererName,
) -> Callable[[], tuple[float, int]]:
    """The paper's method on the whole image with one of `SEARCHES`: gives mu and the number of renders."""
    whole = ImageBox(0, 0, camera.width, camera.height)
    p_hat = T[:3, 3]
    bound = sigma_bound(p_hat)

    def run() -> tuple[float, int]:
        renders = 1
        virtual, _ = render_depth(fruit, T, camera, whole, using)
        valid = (virtual > 0.0) & (depth > 0.0)
        inliers = np.zeros(depth.shape, np.bool_)
        inliers[valid] = line_inliers(virtual[valid], depth[valid], 4e-3)

        def objective(share: Float64) -> float:
            nonlocal renders
            renders += 1
            moved = moved_and_scaled(T, float(np.atleast_1d(share)[0]) * bound)
            rendered, _ = render_depth(fruit, moved, camera, whole, using)
            compared = inliers & (rendered > 0.0)
            return 1e6 * float(
                np.mean((depth[compared].astype(np.float64) - rendered[compared]) ** 2)
            )

        found = minimize(
            objective, [0.0], method=name, bounds=[(-1.0, 1.0)], options=SEARCHES[name]
        )
        sigma = float(np.atleast_1d(found.x)[0]) * bound
        return 1.0 - sigma / float(np.linalg.norm(p_hat)), renders

    return run


def timed(run: Callable[[], tuple[float, int]], rounds: int = 3) -> tuple[float, float, int]:
    """Shortest duration [ms], mu, renders."""
    shortest = np.inf
    for _ in range(rounds):
        start = time.perf_counter()
        mu, renders = run()
        shortest = min(shortest, time.perf_counter() - start)
    return 1e3 * shortest, mu, renders
