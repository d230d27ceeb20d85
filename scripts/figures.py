"""The figures of docs/method.md, drawn from the libraries' results: `make figures`. Their numbers are kept beside the
pictures, in docs/images/method.json. A test computes the numbers anew, so a figure cannot stay behind the code that it
shows.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pomona.drivers.depth_model import SIMULATED
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.palette import INK, LINE, MUTED, SERIES
from pomona.skills.geometry import rot_x, transform
from pomona.skills.grip.limit_surface import limit_surface
from pomona.skills.grip.observer import DynamicSettings, ObserverSettings
from pomona.skills.motion.grasps.sphere import (
    Sphere,
    pre_grasp_orientation,
    pre_grasp_position,
)
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement.render import render_depth, renderer
from pomona.skills.perception.refinement.scale_fit import fit_scale, moved_and_scaled
from tests.skills.grip.observer_arrays import dynamic_force, observe_slip

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
NUMBERS = IMAGES / "method.json"

Series = dict[str, list[float]]
"""Numbers by quantity, with the unit in the name."""

CAMERA = Intrinsics(610.0, 610.0, 320.0, 240.0, 640, 480)
"""About a D435i's at 640 x 480."""


def scale() -> Series:
    """The paper's eq. (f_obj) over sigma for an apple of 0.7 times the model's size with a leaf before it."""
    apple, draw = load_fruit("apple"), renderer("zbuffer")
    T_camera_object = transform(rot_x(0.6), np.array([0.03, 0.02, 0.62]))
    true_sigma = 0.3 * float(np.linalg.norm(T_camera_object[:3, 3]))
    virtual, box = render_depth(apple, T_camera_object, CAMERA, using="zbuffer")
    depth = draw(apple, moved_and_scaled(T_camera_object, true_sigma), CAMERA, box).astype(
        np.float64
    )
    rng = np.random.default_rng(4)
    depth += rng.normal(size=depth.shape) * SIMULATED.deviation(depth, CAMERA.fx)
    depth[:, : depth.shape[1] // 4] -= 0.05  # a leaf over the left quarter
    fit = fit_scale(depth.astype(np.float32), virtual)
    tried = true_sigma + np.linspace(-0.06, 0.06, 61)
    of_all, of_inliers = [], []
    for sigma in tried:
        square = (
            1e3 * (depth - (1.0 - sigma / np.linalg.norm(T_camera_object[:3, 3])) * virtual)
        ) ** 2
        of_all.append(float(square[virtual > 0.0].mean()))
        of_inliers.append(float(square[fit.inliers].mean()))
    return {
        "sigma [mm]": [1e3 * float(s) for s in tried],
        "all pixels [mm²]": of_all,
        "inliers [mm²]": of_inliers,
        "true sigma [mm]": [1e3 * true_sigma],
        "closed form [mm]": [1e3 * (1.0 - fit.mu) * float(np.linalg.norm(T_camera_object[:3, 3]))],
    }


def surface() -> Series:
    """Return the force and moment that a contact bears together, for two pressure distributions, and the ellipsoid."""
    c = np.concatenate([np.linspace(0.0, 2.0, 81), np.geomspace(2.1, 200.0, 40)])
    angle = np.linspace(0.0, 0.5 * np.pi, 61)
    series = {"ellipsoid f": np.sin(angle).tolist(), "ellipsoid tau": np.cos(angle).tolist()}
    for k in (2.0, 4.0):
        f, tau = limit_surface(c, k)
        series |= {f"k={k:g} f": f.tolist(), f"k={k:g} tau": tau.tolist()}
    return series


def slip() -> Series:
    """Return the observer's velocity and the dynamic force for a moment above the friction's limit for 40 ms."""
    t = np.arange(0.0, 0.4, 0.002)
    bears = 0.06
    y = np.interp(t, [0.0, 0.05, 0.10, 0.14, 0.20, 0.4], [0.02, 0.02, 0.063, 0.063, 0.045, 0.045])
    inertia = ObserverSettings().inertia
    omega = observe_slip(y, bears, inertia, ObserverSettings())
    return {
        "t [s]": t.tolist(),
        "torque [mN·m]": (1e3 * y).tolist(),
        "bears [mN·m]": [1e3 * bears],
        "omega [rad/s]": omega.tolist(),
        "f_nd [N]": dynamic_force(omega, DynamicSettings()).tolist(),
    }


def sphere() -> Series:
    """Pre-grasps around a fruit in the origin, in the order in which they are sampled."""
    chosen = Sphere()
    poses = np.array(
        [
            transform(
                pre_grasp_orientation(theta, alpha),
                pre_grasp_position(np.zeros(3), chosen.radius, theta, alpha),
            )
            for theta, alpha in chosen.attempts()
        ]
    )
    names = ("x [m]", "y [m]", "z [m]")
    places = {name: poses[:, i, 3].tolist() for i, name in enumerate(names)}
    return places | {f"approach {'xyz'[i]}": poses[:, i, 2].tolist() for i in range(3)}


FIGURES: dict[str, Callable[[], Series]] = {
    "scale": scale,
    "surface": surface,
    "slip": slip,
    "sphere": sphere,
}


def _axes(width: float = 7.0, height: float = 3.4, rows: int = 1, **options: Any) -> Any:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    plt.rcParams.update({
        "svg.hashsalt": "pomona", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 10,
        "text.color": INK,
        "axes.edgecolor": MUTED, "axes.labelcolor": INK, "xtick.color": MUTED, "ytick.color": MUTED, "grid.color": LINE,
        "axes.grid": True, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False,
    })  # fmt: skip
    return plt.subplots(rows, 1, figsize=(width, height), layout="constrained", **options)


def draw_scale(n: Series) -> Any:
    """Mean square over sigma: with all pixels, and with those that agree."""
    figure, axes = _axes()
    axes.semilogy(
        n["sigma [mm]"], n["all pixels [mm²]"], color=SERIES[1], label="all pixels of the model"
    )
    axes.semilogy(n["sigma [mm]"], n["inliers [mm²]"], color=SERIES[0], label="pixels that agree")
    axes.axvline(n["true sigma [mm]"][0], color=MUTED, linestyle=":", label="true size")
    axes.axvline(n["closed form [mm]"][0], color=SERIES[2], linestyle="--", label="closed form")
    axes.set(xlabel="σ [mm]", ylabel="mean square [mm²]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def draw_surface(n: Series) -> Any:
    """Share of the torsional limit over share of the tangential one."""
    figure, axes = _axes(5.6, 3.8)
    for k, colour, line in (("2", SERIES[0], "-"), ("4", SERIES[2], ":")):  # they lie on each other
        axes.plot(
            n[f"k={k} f"],
            n[f"k={k} tau"],
            color=colour,
            linestyle=line,
            label=f"exact, pressure with k = {k}",
        )
    axes.plot(
        n["ellipsoid f"], n["ellipsoid tau"], color=SERIES[3], linestyle="--", label="ellipsoid"
    )
    axes.set(
        xlabel="tangential force / (μ f_n)",
        ylabel="moment / τ_max",
        xlim=(0.0, 1.05),
        ylim=(0.0, 1.05),
    )
    axes.legend(loc="lower left")
    return figure


def draw_slip(n: Series) -> Any:
    """Torque, observed velocity and dynamic force over time, one below the other."""
    figure, (top, middle, low) = _axes(7.0, 5.4, 3, sharex=True)
    top.plot(n["t [s]"], n["torque [mN·m]"], color=SERIES[0])
    top.axhline(n["bears [mN·m]"][0], color=SERIES[1], linestyle=":", label="limit of friction")
    top.set(ylabel="load [mN·m]")
    top.legend(loc="lower right")
    middle.plot(n["t [s]"], n["omega [rad/s]"], color=SERIES[2])
    middle.set(ylabel="ω̂ [rad/s]")
    low.plot(n["t [s]"], n["f_nd [N]"], color=SERIES[3])
    low.set(ylabel="f_nd [N]", xlabel="t [s]")
    return figure


def draw_sphere(n: Series) -> Any:
    """The pre-grasps with their approach, from the side."""
    figure, axes = _axes(5.6, 5.0, subplot_kw={"projection": "3d"})
    x, y, z = (np.array(n[f"{a} [m]"]) for a in "xyz")
    axes.quiver(
        x,
        y,
        z,
        *(0.05 * np.array(n[f"approach {a}"]) for a in "xyz"),
        color=SERIES[0],
        linewidth=1.0,
    )
    axes.scatter([0.0], [0.0], [0.0], color=SERIES[1], s=220, depthshade=False)
    axes.set(
        xlabel="x [m]",
        ylabel="y [m]",
        zlabel="z [m]",
        xlim=(-0.1, 0.1),
        ylim=(-0.1, 0.1),
        zlim=(-0.05, 0.15),
    )
    axes.set(xticks=(-0.1, 0.0, 0.1), yticks=(0.0, 0.1), zticks=(0.0, 0.1))
    axes.view_init(20.0, -60.0)
    return figure


DRAWN: dict[str, Callable[[Series], Any]] = {
    "scale": draw_scale, "surface": draw_surface, "slip": draw_slip, "sphere": draw_sphere,
}  # fmt: skip


def numbers() -> dict[str, Series]:
    """Return the numbers of all figures, as the code computes them now."""
    return {name: compute() for name, compute in FIGURES.items()}


def main() -> None:
    """Compute, draw and write all figures."""
    found = numbers()
    for name, series in found.items():
        DRAWN[name](series).savefig(IMAGES / f"method_{name}.svg", metadata={"Date": None})
    rounded = {
        n: {k: [float(f"{v:.6g}") for v in values] for k, values in s.items()}
        for n, s in found.items()
    }
    NUMBERS.write_text(
        json.dumps(rounded, ensure_ascii=False, separators=(",", ":")) + "\n", encoding="utf-8"
    )


if __name__ == "__main__":
    main()
