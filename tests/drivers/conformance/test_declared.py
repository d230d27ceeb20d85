"""What drivers declare that they do not keep stands on the page of the hardware, and is a claim that they may leave."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from pomona.drivers import Driver
from pomona.drivers.conformance import ARM, CAMERA, FORCE_SENSOR, GRIPPER, SIGNALS, Claims

PAGE = Path(__file__).parents[3] / "docs" / "hardware.md"


def declared() -> Iterator[tuple[str, str]]:
    """Yield each driver that declares a claim, and the claim."""
    for point in entry_points(group="pomona.drivers"):
        driver = point.load()
        assert isinstance(driver, Driver)
        yield from ((point.name, claim) for claim in driver.device.declared)


def test_what_is_declared_stands_on_the_page_of_the_hardware() -> None:
    text = PAGE.read_text("utf-8")
    rows = {(name, claim.replace("_", " ")) for name, claim in declared()}
    assert rows
    for name, words in rows:
        assert f"| `{name}` | {words} |" in text


def test_what_is_declared_is_a_claim_that_may_be_declared_away() -> None:
    kinds: tuple[Claims[Any], ...] = (ARM, CAMERA, FORCE_SENSOR, GRIPPER, SIGNALS)
    may = {claim.name for kind in kinds for claim in kind.all if not claim.essential}
    assert {claim for _, claim in declared()} <= may
