"""The pads of a cell file: friction of each pair, and refusals."""

from pathlib import Path

import pytest

from pomona.drivers.interfaces import PadContact, Pads
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.errors import CellFileError

PADS = "driver: pads, delta: 6 mm, gamma: 0.1, stiffness: 2 kN/m, friction: "


def pads_of(folder: Path, friction: str) -> Pads:
    cell = folder / "cell.yaml"
    text = (
        f"name: mine\nkind: mock\nworld: {{driver: mock}}\ndevices:\n  pads: {{{PADS}{friction}}}\n"
    )
    cell.write_text(text)
    connected = load_cell(cell, seed=0)
    pads: Pads = connected.device(Pads)
    connected.close()
    return pads


def test_each_kind_of_fruit_has_its_friction_and_the_others_have_theirs(tmp_path: Path) -> None:
    friction = "{apple: 0.76..0.84, any: 0.5}"
    pads = pads_of(tmp_path, friction)
    apple = pads.on("apple")
    assert (apple.mu, apple.uncertainty) == pytest.approx((0.8, 0.05))
    assert pads.on("pear") == PadContact(0.5, 0.0, 0.006, 0.1, 2000.0)


@pytest.mark.parametrize(
    ("friction", "words"),
    [
        ("{apple: 0.8}", "'any' is missing"),
        ("{any: 8}", "between 0.05 and 3"),
        ("{any: 0.8..0.7}", "any"),
    ],
)
def test_pads_without_a_friction_for_every_fruit_are_refused(
    tmp_path: Path, friction: str, words: str
) -> None:
    with pytest.raises(CellFileError, match=words):
        pads_of(tmp_path, friction)
