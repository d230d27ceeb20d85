"""Skills are found by entry point; an unusable one is reported and does not stop the others."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from typing import Annotated

import pytest

from pomona.executive import registry
from pomona.executive.commands.command_line import make_parser
from pomona.executive.language import check, read
from pomona.executive.ports import LENGTH, Length, Outputs, Port
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill, Work


class Basket:
    """A type that skills exchange."""


class Weighed(Outputs):
    result: float


class Weigh(Skill):
    """Weigh a basket.

    And more about it.
    """

    failures = ("TOO_HEAVY",)

    def run(
        self,
        basket: Basket,
        height: Annotated[Length, Port(max="1 m", help="above the scale")] = LENGTH("3 cm"),
    ) -> Work[Weighed]:
        yield None
        return Weighed(1.0)


@pytest.fixture
def installed(monkeypatch):
    def install(*points):
        monkeypatch.setattr(
            registry, "entry_points", lambda group: points if group == registry.GROUP else ()
        )
        return Registry.installed()

    return install


class FakePoint:
    def __init__(self, name, loaded):
        self.name, self.value, self.loaded = name, f"somewhere:{name}", loaded

    def load(self):
        return self.loaded


def test_skills_are_found_by_entry_point(installed):
    found = installed(FakePoint("Weigh", Weigh))
    assert dict(found) == {"Weigh": Weigh}
    assert found.types["basket"] is Basket
    assert found.problems == {}


def test_a_skill_that_cannot_be_imported_is_reported(installed):
    found = installed(
        EntryPoint("Lost", "no_such_module:Lost", registry.GROUP), FakePoint("Weigh", Weigh)
    )
    assert list(found) == ["Weigh"]
    assert "ModuleNotFoundError" in found.problems["Lost"]


def test_a_class_that_is_no_skill_is_reported(installed):
    assert "not a Skill" in installed(FakePoint("Basket", Basket)).problems["Basket"]


def test_the_listing_is_complete_for_a_reader(installed):
    (listing,) = installed(FakePoint("Weigh", Weigh)).listing()
    assert (listing.name, listing.summary, listing.failures) == (
        "Weigh",
        "Weigh a basket.",
        ("TOO_HEAVY",),
    )
    assert listing.inputs[1] == {
        "name": "height",
        "type": "length",
        "units": ["m", "cm", "mm", "um"],
        "required": False,
        "default": "3 cm",
        "max": "1 m",
        "help": "above the scale",
    }
    assert listing.outputs == ({"name": "result", "type": "number", "required": True},)


def test_the_installed_skills_can_be_listed():
    found = Registry.installed()
    assert [listing.name for listing in found.listing()] == sorted(found)


class FakePackage:
    def __init__(self, name: str) -> None:
        self.name = name


def test_a_skill_that_two_packages_offer_is_refused_until_one_is_chosen(monkeypatch, installed):
    class Other(Weigh):
        """Another one."""

    points = FakePoint("Weigh", Weigh), FakePoint("Weigh", Other)
    for point, package in zip(points, ("pomona", "others"), strict=True):
        point.dist, point.value = FakePackage(package), f"{package}:Weigh"
    found = installed(*points)
    assert "Weigh" not in found
    assert found.problems["Weigh"] == (
        "others and pomona both offer it: remove one, or choose: "
        "skills: {Weigh: others} in the tree, or pomona --skill Weigh=others"
    )
    monkeypatch.setenv("POMONA_SKILLS", "Weigh=others")
    assert installed(*points)["Weigh"] is Other
    monkeypatch.setenv("POMONA_SKILLS", "Weigh=nobody")
    assert "'nobody' offers no Weigh" in installed(*points).problems["Weigh"]


def test_a_tree_names_the_package_of_a_skill_and_the_command_overrides_it(monkeypatch, installed):
    class Other(Weigh):
        """Another one."""

    points = FakePoint("Weigh", Weigh), FakePoint("Weigh", Other)
    for point, package in zip(points, ("pomona", "others"), strict=True):
        point.dist, point.value = FakePackage(package), f"{package}:Weigh"
    found = installed(*points)
    tree = "pomona: 1\ntree: t\nskills: {Weigh: %s}\nroot: {Weigh: {basket: '{b}'}}\n"
    codes = [finding.code for finding in check(read(tree % "others", "t.yaml"), found)]
    assert "broken-skill" not in codes
    assert found.choosing({"Weigh": "others"})["Weigh"] is Other
    finding = check(read(tree % "nobody", "t.yaml"), found)[0]
    assert (finding.code, finding.line, finding.column) == ("broken-skill", 3, 17)
    monkeypatch.setenv("POMONA_SKILLS", "")
    make_parser(["schema"]).parse_args(["--skill", "Weigh=pomona", "schema"])
    assert found.choosing({"Weigh": "others"})["Weigh"] is Weigh


def test_a_choice_that_is_none_is_refused(capsys):
    with pytest.raises(SystemExit):
        make_parser([]).parse_args(["--skill", "Weigh"])
    assert "NAME=PACKAGE" in capsys.readouterr().err
