"""A port is declared once, in the signature of `run`; a mistake is an error when the class is made."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from hypothesis import given, strategies as st
from py_trees.common import Status

from pomona.executive.errors import SkillError
from pomona.executive.ports import (
    FORCE,
    LENGTH,
    MASS,
    RATIO,
    REQUIRED,
    Force,
    Length,
    Mass,
    Outputs,
    Port,
    Ports,
    Ratio,
)
from pomona.executive.skill import Skill, Work
from pomona.executive.skill_testing import drive


class Basket:
    """A type that skills exchange."""


class Weighed(Outputs):
    mass: Annotated[Mass, Port(help="of what is in it")]
    count: int


class Weigh(Skill):
    """Weigh a basket."""

    def run(
        self,
        basket: Basket,
        height: Annotated[Length, Port(min="1 mm", max="1 m", help="above the scale")] = LENGTH(
            "3 cm"
        ),
        how: Literal["quickly", "exactly"] = "exactly",
        share: Ratio = 0.5,
        before: Basket | None = None,
        after: Annotated[Basket | None, Port(help="emptied")] = None,
    ) -> Work[Weighed]:
        yield None
        return Weighed(mass=height, count=3)


def test_inputs_are_the_parameters_of_run():
    assert dict(Weigh.inputs) == {
        "basket": Port(Basket),
        "height": Port(LENGTH, default=0.03, min="1 mm", max="1 m", help="above the scale"),
        "how": Port(str, default="exactly", choices=("quickly", "exactly")),
        "share": Port(RATIO, default=0.5),
        "before": Port(Basket, default=None),
        "after": Port(Basket, default=None, help="emptied"),
    }


def test_outputs_are_the_fields_of_the_value_that_run_returns():
    assert dict(Weigh.outputs) == {"mass": Port(MASS, help="of what is in it"), "count": Port(int)}


def test_returned_values_are_written_to_its_ports():
    outcome = drive(Weigh(), {"basket": Basket()})
    assert outcome.status is Status.SUCCESS
    assert outcome.outputs == {"mass": 0.03, "count": 3}


def test_outputs_of_instant_work_and_of_none():
    class Instant(Skill):
        def run(self) -> Weighed:
            return Weighed(1.0, 2)

    class Mute(Skill):
        def run(self) -> None:
            return None

    assert drive(Instant()).outputs == {"mass": 1.0, "count": 2}
    assert dict(Mute.outputs) == {}
    assert drive(Mute()).outputs == {}


def test_a_subclass_with_the_same_run_has_the_same_ports():
    class Again(Weigh):
        failures = ("EMPTY",)

    assert dict(Again.inputs) == dict(Weigh.inputs)


def test_a_run_with_any_arguments_declares_its_ports_in_the_class():
    class Mock(Skill):
        inputs = Ports(force=FORCE)

        def run(self, **inputs: Any) -> None:
            return None

    assert dict(Mock.inputs) == {"force": Port(FORCE)}


class Felt(Outputs):
    force: Force


def made(run: Any, **members: Any) -> type[Skill]:
    return type("Made", (Skill,), {"run": run, **members})


def no_annotation(self, force) -> None: ...
def no_result(self, force: Force): ...
def unknown_name(self, force: Newton) -> None: ...  # type: ignore[name-defined]  # noqa: F821
def wrong_result(self) -> dict[str, float]: ...
def bare_default(self, force: Annotated[Force, Port(max="1 N")] = 2.0) -> None: ...
def wrong_unit(self, force: Annotated[Force, Port(max="1 mm")] = 2.0) -> None: ...
def crossed(self, force: Annotated[Force, Port(min="2 N", max="1 N")]) -> None: ...
def wrong_type(self, count: int = 0.5) -> None: ...
def not_a_choice(self, how: Literal["a", "b"] = "c") -> None: ...
def none_for_a_number(self, force: Force = None) -> None: ...
def something_for_none(self, basket: Basket | None = "basket") -> None: ...
def twice(self, force: Annotated[Force, LENGTH]) -> None: ...
def no_float(self, force: Annotated[int, FORCE]) -> None: ...
def no_type(self, force: int | str) -> None: ...
def both_ways(self, force: Force) -> Felt: ...


@pytest.mark.parametrize(
    ("run", "sentence"),
    [
        (no_annotation, "parameter force has no annotation"),
        (no_result, "run has no return annotation"),
        (unknown_name, "annotations of run cannot be read: name 'Newton' is not defined"),
        (wrong_result, "outputs are the fields of an Outputs class"),
        (bare_default, "force: the default 2.0 is out of its range"),
        (wrong_unit, "'mm' is no unit of force"),
        (crossed, "force: min 2 N is above max 1 N"),
        (wrong_type, "count: the default 0.5 is not of its type"),
        (not_a_choice, "how: the default 'c' is not one of a, b"),
        (none_for_a_number, "force: the default is None, so its type must be one that may be None"),
        (something_for_none, "basket may be None, so its default must be None"),
        (twice, "force is declared twice"),
        (no_float, "a force is a float"),
        (no_type, "is no type that a port can carry"),
        (both_ways, "force is an input and an output"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_mistake_is_an_error_when_the_class_is_made(run, sentence):
    with pytest.raises(SkillError, match=sentence):
        made(run)


def test_ports_are_not_declared_twice():
    def run(self, force: Force) -> None: ...

    with pytest.raises(SkillError, match="inputs are declared by the signature of run already"):
        made(run, inputs=Ports(force=FORCE))


@given(st.floats(0.0, 2.0), st.floats(0.0, 2.0), st.floats(0.0, 2.0))
def test_a_default_is_accepted_exactly_within_its_range(least, most, default):
    def run(self, force) -> None: ...

    run.__annotations__ = {"force": Annotated[Force, Port(min=least, max=most)], "return": None}
    run.__defaults__ = (default,)
    if least <= default <= most:
        assert made(run).inputs["force"].default == default
    else:
        with pytest.raises(SkillError):
            made(run)


def test_a_port_without_default_must_be_wired():
    assert Weigh.inputs["basket"].default is REQUIRED
