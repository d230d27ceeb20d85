"""Scenes for the tests of Refine: fruit on a table, seen by a depth camera with the errors of a D435i."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.interfaces import Intrinsics
from skills.fruit import FruitModel, load_fruit

INTRINSICS = Intrinsics(610.6, 610.6, 322.3, 241.9, 640, 480)


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh that is no catalogue fruit."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]


@pytest.fixture(scope="session")
def apple() -> FruitModel:
    return load_fruit("apple")


@pytest.fixture
def camera() -> Intrinsics:
    return INTRINSICS
