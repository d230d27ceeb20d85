"""scripts/figures.py: what the figures of docs/method.md show is what the code computes today."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def figures() -> ModuleType:
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("figures", ROOT / "scripts" / "figures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["scale", "surface", "slip", "sphere"])
def test_a_figure_shows_what_the_code_computes(figures: Any, name: str) -> None:
    drawn, now = json.loads(figures.NUMBERS.read_text("utf-8"))[name], figures.FIGURES[name]()
    assert drawn.keys() == now.keys(), "make figures"
    for series, values in now.items():
        np.testing.assert_allclose(drawn[series], values, rtol=1e-4, atol=1e-6, err_msg=f"{series}: make figures")
    assert (figures.IMAGES / f"method_{name}.svg").stat().st_size > 1000


def test_every_figure_is_on_the_page(figures: Any) -> None:
    page = (ROOT / "docs" / "method.md").read_text("utf-8")
    assert all(f"images/method_{name}.svg" in page for name in figures.FIGURES)
    assert figures.FIGURES.keys() == figures.DRAWN.keys()
