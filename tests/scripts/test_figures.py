"""scripts/figures.py and pictures.py: figures show the present results of the code, and no picture is older than its
sources.
"""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]


def script(name: str) -> ModuleType:
    """A script as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # its dataclasses ask for it
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def figures() -> ModuleType:
    return script("figures")


@pytest.mark.parametrize("name", ["scale", "surface", "slip", "sphere"])
def test_a_figure_shows_values_of_the_code(figures: Any, name: str) -> None:
    drawn, now = json.loads(figures.NUMBERS.read_text("utf-8"))[name], figures.FIGURES[name]()
    assert drawn.keys() == now.keys(), "make figures"
    for series, values in now.items():
        np.testing.assert_allclose(
            drawn[series], values, rtol=1e-4, atol=1e-6, err_msg=f"{series}: make figures"
        )
    assert (figures.IMAGES / f"method_{name}.svg").stat().st_size > 1000


def test_every_figure_is_on_the_page(figures: Any) -> None:
    page = (ROOT / "docs" / "method.md").read_text("utf-8")
    assert all(f"images/method_{name}.svg" in page for name in figures.FIGURES)
    assert figures.FIGURES.keys() == figures.DRAWN.keys()


@pytest.fixture(scope="module")
def pictures() -> ModuleType:
    return script("pictures")


def test_no_picture_is_older_than_its_sources(pictures: Any) -> None:
    assert not pictures.behind(), "make figures"
    for name, entry in pictures.ledger().items():
        assert (pictures.IMAGES / name).stat().st_size < 3_000_000
        assert entry["command"] == "make figures"
        assert re.fullmatch(r"[0-9a-f]{7,}\+?", entry["commit"]), name


def test_every_picture_is_one_that_is_made(pictures: Any) -> None:
    there = {path.name for path in pictures.IMAGES.iterdir() if not path.name.startswith("method")}
    assert (
        there - {"made.json", "grip_modes.svg"}
        == pictures.PICTURES.keys()
        >= pictures.ledger().keys()
    )


def test_pictures_are_distinguished_from_afar(pictures: Any, tmp_path: Path) -> None:
    picture = np.full((90, 160, 3), 200, np.uint8)
    noisy = picture.copy()
    noisy[::9, ::7] -= 20
    other = picture.copy()
    other[20:60, 40:120] = 20
    for name, pixels in (("a", picture), ("b", noisy), ("c", other), ("d", picture[:80])):
        Image.fromarray(pixels).save(tmp_path / f"{name}.png")
    assert pictures.looks_the_same(tmp_path / "a.png", tmp_path / "b.png")
    assert not pictures.looks_the_same(tmp_path / "a.png", tmp_path / "c.png")
    assert not pictures.looks_the_same(tmp_path / "a.png", tmp_path / "d.png")


def test_a_picture_that_looks_as_it_was_is_made_anew_only_where_its_figures_changed(
    pictures: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shade, peak = [200], [6.14]

    def draw(out: Path) -> None:
        Image.fromarray(np.full((90, 160, 3), shade[0], np.uint8)).save(out)

    monkeypatch.setattr(pictures, "ROOT", tmp_path)
    monkeypatch.setattr(pictures, "IMAGES", tmp_path)
    (tmp_path / "source").touch()
    monkeypatch.setitem(
        pictures.PICTURES,
        "a.png",
        pictures.Picture(draw, ("source",), lambda: {"peak [N]": peak[0]}),
    )
    entries: dict[str, Any] = {}
    pictures.make("a.png", entries)
    first = (tmp_path / "a.png").read_bytes()
    shade[0] = 201
    pictures.make("a.png", entries)
    assert (tmp_path / "a.png").read_bytes() == first
    peak[0] = 4.98
    pictures.make("a.png", entries)
    assert (tmp_path / "a.png").read_bytes() != first
    assert entries["a.png"]["shows"] == {"peak [N]": 4.98}
