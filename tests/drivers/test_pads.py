"""The pads of a cell file: friction of each pair, and refusals."""

from pathlib import Path

import pytest

from pomona.drivers.interfaces import PadContact, Pads
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.errors import CellFileError
from pomona.skills.grip.limit_surface import SoftContact

PADS = "driver: pads, stiffness: 2 kN/m, friction: "
TWISTED = ", delta: 6 mm, gamma: 0.1"


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
    friction = "{apple: 0.76..0.84, any: 0.5}" + TWISTED + ", measured: twice"
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
        ("{any: 0.8}" + TWISTED, "without a measurement a grip relies on 2.99 mm"),
    ],
)
def test_pads_without_a_friction_for_every_fruit_are_refused(
    tmp_path: Path, friction: str, words: str
) -> None:
    with pytest.raises(CellFileError, match=words):
        pads_of(tmp_path, friction)


def test_pads_that_nobody_twisted_bear_no_more_torsion_than_the_stiffest(tmp_path: Path) -> None:
    told = pads_of(tmp_path, "{any: 0.5}").on("apple")
    contact = SoftContact(told.mu, told.delta, told.gamma)
    assert contact.torsion / told.mu == pytest.approx(1.9e-3, rel=1e-3)
