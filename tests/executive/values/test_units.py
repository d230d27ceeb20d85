"""One table of units: every unit converts, and a number without its unit is refused in words."""

import math

import pytest
from hypothesis import given, strategies as st

from pomona.executive.values.units import (
    ANGLE,
    LENGTH,
    QUANTITIES,
    RATE,
    RATIO,
    STIFFNESS,
    TIME,
    Quantity,
)

UNITS = [
    (quantity, unit) for quantity in QUANTITIES.values() for unit in quantity.units if unit != "1"
]


@given(st.floats(-1e6, 1e6), st.sampled_from(UNITS))
def test_every_unit_converts_as_it_says(value, unit):
    quantity, name = unit
    assert quantity.parse(f"{value!r} {name}") == pytest.approx(value * quantity.units[name])
    with pytest.raises(ValueError, match="no unit of"):
        quantity.parse(f"{value!r} furlong")


@given(st.floats(-1e6, 1e6), st.sampled_from([q for q in QUANTITIES.values() if q != RATIO]))
def test_a_bare_number_is_refused_wherever_a_unit_belongs(value, quantity):
    with pytest.raises(ValueError, match="lacks a unit"):
        quantity.parse(repr(value))


def test_a_refusal_has_the_article_that_its_quantity_has():
    with pytest.raises(ValueError, match="an angle is given in rad"):
        QUANTITIES["angle"].parse("10")
    with pytest.raises(ValueError, match="is not a number of pixels"):
        QUANTITIES["pixels"].parse(".nan px")


def test_a_ratio_may_be_bare_or_in_percent():
    assert RATIO.parse("0.25") == RATIO.parse("25 %") == 0.25


def test_the_first_unit_of_every_quantity_is_si():
    assert all(quantity.units[quantity.si_unit] == 1.0 for quantity in QUANTITIES.values())


def test_a_unit_measures_one_quantity_only():
    names = [name for _, name in UNITS]
    assert len(names) == len(set(names))


@pytest.mark.parametrize(
    ("quantity", "text", "si"),
    [
        (LENGTH, "120 mm", 0.12),
        (LENGTH, "-1.5e2mm", -0.15),
        (ANGLE, "180°", math.pi),
        (STIFFNESS, "2 kN/m", 2000.0),
        (STIFFNESS, "2 N/mm", 2000.0),
        (RATE, "5 1/s", 5.0),
        (RATE, "5 Hz", 5.0),
    ],
)
def test_quantities_are_read_as_people_write_them(quantity, text, si):
    assert quantity.parse(text) == pytest.approx(si)


@pytest.mark.parametrize(
    "text", ["", "mm", "1 2 mm", "1e999 m", "inf m", "nan", "51/s", "١ m", "--1 m", "1,5 m"]
)
def test_a_text_without_a_quantity_is_refused(text):
    for quantity in (LENGTH, RATE):
        with pytest.raises(ValueError, match=quantity.name):
            quantity.parse(text)


def test_a_time_of_centuries_is_refused():
    assert TIME.parse("8760 h") == 8760 * 3600
    for text in ("1e30 s", "-1e10 s", "3e6 h"):
        with pytest.raises(ValueError, match="is too large for a time"):
            TIME.parse(text)


@given(st.text(max_size=60))
def test_any_text_is_a_length_or_refused_in_words(text):
    try:
        value = LENGTH.parse(text)
    except ValueError as refused:
        said = str(refused)
    else:
        said = "length" if math.isfinite(value) else ""
    assert "length" in said


SAME = """
    1 m = 100 cm; 1 cm = 10 mm; 1 mm = 1000 um; 1 h = 60 min; 1 min = 60 s; 1 s = 1000 ms; 1 ms = 1000 us
    1 kg = 1000 g; 1 N = 1000 mN
    1 N·m = 1000 N·mm; 1 Nm = 1 N·m; 1 Nmm = 1 N·mm; 1 N/mm = 1 kN/m; 1 kN/m = 1000 N/m
    1 MPa = 10 bar; 1 bar = 100 kPa; 1 kPa = 1000 Pa
    1 m/s = 100 cm/s; 1 cm/s = 10 mm/s; 1 m/s² = 1 m/s^2; 1 m/s² = 1000 mm/s²; 1 mm/s^2 = 1 mm/s²
    1 kHz = 1000 Hz; 1 Hz = 1 1/s
    180 deg = 180 °; 180 ° = 3.141592653589793 rad; 180 deg/s = 180 °/s; 180 °/s = 3.141592653589793 rad/s
"""  # fmt: skip


def test_units_are_as_large_as_everybody_knows():
    seen = {"px"}
    for equation in SAME.replace("\n", ";").split(";"):
        if sides := equation.strip():
            one, other = sides.split(" = ")
            (quantity,) = (q for q in QUANTITIES.values() if one.split(" ")[1] in q.units)
            assert quantity.parse(one) == pytest.approx(quantity.parse(other), rel=1e-12), sides
            seen |= {one.split(" ")[1], other.split(" ")[1]}
    assert {name for _, name in UNITS} - {"%"} == seen


@pytest.mark.parametrize(
    ("quantity", "si", "text"),
    [
        (LENGTH, 0.12, "12 cm"),
        (LENGTH, -0.12, "-12 cm"),
        (LENGTH, 1.0, "1 m"),
        (LENGTH, 1.234, "1.234 m"),
        (LENGTH, 0.0015, "1.5 mm"),
        (LENGTH, 1500.0, "1500 m"),
        (LENGTH, 0.0, "0 m"),
        (TIME, 600.0, "10 min"),
        (RATIO, 0.25, "0.25"),
    ],
)
def test_a_value_is_written_in_the_unit_that_keeps_it_short(quantity, si, text):
    assert quantity.format(si) == text
    assert quantity.parse(text) == pytest.approx(si)


PREFIXES = {"": 1.0, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6}
BASES = {
    "m": 1.0, "rad": 1.0, "deg": math.pi / 180.0, "°": math.pi / 180.0, "s": 1.0, "min": 60.0, "h": 3600.0,
    "g": 1e-3, "N": 1.0, "Pa": 1.0, "bar": 1e5, "Hz": 1.0, "px": 1.0, "%": 0.01, "1": 1.0,
}  # fmt: skip


def size_of(unit: str) -> float:
    """The size of a unit in SI, by its prefix and its parts."""
    if "/" in unit:
        above, below = unit.split("/")
        return size_of(above) / size_of(below)
    if unit.endswith(("²", "^2")):
        return size_of(unit.rstrip("²").removesuffix("^2")) ** 2
    for left in ("N·", "N"):
        if unit.startswith(left) and unit.removeprefix(left) in ("m", "mm"):
            return size_of(unit.removeprefix(left))
    for prefix, factor in PREFIXES.items():
        if unit.startswith(prefix) and unit.removeprefix(prefix) in BASES:
            return factor * BASES[unit.removeprefix(prefix)]
    raise AssertionError(unit)


@pytest.mark.parametrize("quantity", QUANTITIES.values(), ids=QUANTITIES)
def test_every_unit_has_the_size_of_its_prefix_and_its_parts(quantity: Quantity) -> None:
    for unit, size in quantity.units.items():
        assert size == pytest.approx(size_of(unit), rel=1e-12), unit
        assert quantity(f"3 {unit}".removesuffix(" 1")) == pytest.approx(3.0 * size)
    assert next(iter(quantity.units)) == quantity.si_unit


@pytest.mark.parametrize(
    ("quantity", "value", "text"),
    [
        ("length", 0.12, "12 cm"), ("length", 0.1234, "12.34 cm"), ("length", 1.0, "1 m"), ("length", 0.001, "1 mm"),
        ("length", 999.9e-6, "999.9 um"), ("length", 0.0, "0 m"), ("length", 5000.0, "5000 m"), ("time", 60.0, "1 min"),
        ("time", 90.0, "90 s"), ("time", 0.25, "250 ms"), ("ratio", 0.5, "0.5"), ("mass", -0.5, "-500 g"),
        ("length", 1e-9, "1e-09 m"),
    ],
)  # fmt: skip
def test_a_value_is_written_with_its_shortest_unit(quantity: str, value: float, text: str) -> None:
    assert QUANTITIES[quantity].format(value) == text


def test_a_time_is_bounded_by_three_centuries() -> None:
    assert QUANTITIES["time"]("9999999999 s") == 9999999999.0
    for text in ("10000000000 s", "-10000000000 s"):
        with pytest.raises(ValueError, match="is too large for a time"):
            QUANTITIES["time"](text)
