"""A small network that maps an arm's joints and a goal to the next motion; read from a file without any code.

The file is NumPy's archive (.npz): `format` names it, `joints` in their order, `rate` [1/s] at which it is asked, mean
and scale of inputs and outputs, and for each layer k `W{k}` (inputs x outputs) and `b{k}`, with tanh between them.
Inputs are the joints [rad] and the goal, a position of the tool in the base frame [m]; outputs are the motion of each
joint [rad].
"""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive import ArchiveTooLarge, Float64, open_archive

FORMAT = "pomona-policy-1"
GOAL = 3  # numbers of a goal: x, y, z
MOST_BYTES = 16 << 20  # size limit of a small network's file [byte]
MOST_LAYERS = 16
MOST_MEMBERS = 64  # two for each layer, and seven


class UnusablePolicy(Exception):
    """A file that holds no policy."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path, self.problem = path, problem
        super().__init__(f"{path}: {problem}")


@dataclass(frozen=True, slots=True, eq=False)
class PolicyNetwork:
    """A multilayer perceptron with scales of its inputs and outputs."""

    joints: tuple[str, ...]  # names, in the order of inputs and outputs
    rate: float  # decisions a second with which it was trained
    in_mean: Float64
    in_scale: Float64
    out_mean: Float64
    out_scale: Float64
    layers: tuple[tuple[Float64, Float64], ...]  # weights (inputs, outputs) and biases (outputs,)

    def set_point(self, q: Float64, goal: Float64) -> Float64:
        """Where the joints shall go, shape (dof,) [rad].

        Args:
            q: measured joints, shape (dof,) [rad].
            goal: of the tool's point in the base frame, shape (3,) [m].
        """
        x = (np.concatenate([q, goal]) - self.in_mean) / self.in_scale
        for W, b in self.layers[:-1]:
            x = np.tanh(x @ W + b)
        W, b = self.layers[-1]
        wanted: Float64 = q + self.out_mean + self.out_scale * (x @ W + b)
        return wanted


def write_policy(path: Path, network: PolicyNetwork) -> None:
    """Write the file that `read_policy` reads."""
    layers: dict[str, Any] = {}
    for k, (W, b) in enumerate(network.layers):
        layers |= {f"W{k}": W.astype(np.float32), f"b{k}": b.astype(np.float32)}
    np.savez_compressed(
        path,
        format=FORMAT,
        joints=np.array(network.joints),
        rate=network.rate,
        in_mean=network.in_mean,
        in_scale=network.in_scale,
        out_mean=network.out_mean,
        out_scale=network.out_scale,
        **layers,
    )


def read_policy(path: Path) -> PolicyNetwork:
    """Return the policy in a file.

    Raises UnusablePolicy: it cannot be read, is something else, or its numbers do not fit together.
    """
    try:
        open_archive(path, MOST_BYTES, MOST_MEMBERS).close()
        with np.load(path, allow_pickle=False) as found:
            parts = {name: found[name] for name in found.files}
    except OSError as error:
        raise UnusablePolicy(path, error.strerror or "cannot be read") from error
    except ArchiveTooLarge as error:
        raise UnusablePolicy(path, f"{error}: no policy") from error
    except (ValueError, zipfile.BadZipFile, zlib.error, EOFError, KeyError, MemoryError) as error:
        raise UnusablePolicy(path, "is no archive of NumPy, or a damaged one") from error
    if str(parts.get("format", "")) != FORMAT:
        raise UnusablePolicy(path, f"has no format {FORMAT}")
    try:
        return _checked(path, parts)
    except (KeyError, TypeError, ValueError) as error:
        raise UnusablePolicy(path, f"is incomplete: {error}") from error


def _checked(path: Path, parts: dict[str, Any]) -> PolicyNetwork:
    joints = tuple(str(name) for name in parts["joints"])
    dof, rate = len(joints), float(parts["rate"])
    if not 1.0 <= rate <= 1000.0:
        raise UnusablePolicy(path, f"a rate of {rate:g} Hz is not possible")
    size, layers = dof + GOAL, list[tuple[Float64, Float64]]()
    while f"W{len(layers)}" in parts and len(layers) < MOST_LAYERS:
        W, b = (np.asarray(parts[f"{name}{len(layers)}"], np.float64) for name in "Wb")
        if W.ndim != 2 or W.shape[0] != size or b.shape != W.shape[1:]:
            raise UnusablePolicy(path, f"layer {len(layers)} does not fit the layer before")
        layers.append((W, b))
        size = W.shape[1]
    if not layers or size != dof:
        raise UnusablePolicy(
            path, f"its last layer gives {size if layers else 0} numbers for {dof} joints"
        )
    scales = {}
    for name, length in (
        ("in_mean", dof + GOAL),
        ("in_scale", dof + GOAL),
        ("out_mean", dof),
        ("out_scale", dof),
    ):
        scales[name] = np.asarray(parts[name], np.float64)
        if scales[name].shape != (length,):
            raise UnusablePolicy(path, f"'{name}' must be {length} numbers")
    numbers = [*scales.values(), *(part for layer in layers for part in layer)]
    if not all(np.isfinite(part).all() for part in numbers) or not (scales["in_scale"] > 0.0).all():
        raise UnusablePolicy(
            path, "holds a value that is not finite, or a scale that is not positive"
        )
    return PolicyNetwork(joints, rate, layers=tuple(layers), **scales)
