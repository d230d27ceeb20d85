"""A cell file's mistakes are found with their place and a way out."""

import numpy as np
import pytest

from drivers.cell_file import cell_options, read_cell_file
from drivers.errors import CellFileError


@pytest.fixture
def read(tmp_path):
    def read_text(text, overrides=None):
        path = tmp_path / "cell.yaml"
        path.write_text(text)
        return read_cell_file(path, overrides)

    return read_text


def place(error):
    return error.value.line, error.value.column


def test_values_come_in_si_units(read):
    settings = read(
        "a: 120 mm\nb: 30 deg\nc: 0.5\n"
        "d: [1 mm, 2 mm]\nj: 10 20 mm\ne: yes it is\nf: true\ng: [0.7, 0.9]\nh: 3\ni: 80 g..0.1 kg\n"
    )
    assert settings.number("a", "length") == pytest.approx(0.12)
    assert settings.number("b", "angle") == pytest.approx(np.pi / 6)
    assert settings.number("c") == 0.5
    assert settings.vector("d", 2, "length") == pytest.approx([0.001, 0.002])
    assert settings.vector("j", 2, "length") == pytest.approx([0.01, 0.02])
    assert settings.text("e") == "yes it is"
    assert settings.boolean("f") is True
    assert settings.span("g") == (0.7, 0.9)
    assert settings.span("h") == (3.0, 3.0)
    assert settings.span("i", "mass") == (0.08, 0.1)
    assert settings.integer("h") == 3
    assert settings.number("missing", default=2.5) == 2.5
    settings.finish()


@pytest.mark.parametrize(
    ("text", "ask", "line", "column", "says"),
    [
        ("x: 1\nrange: -5 N\n", lambda s: s.number("range", "force", low=0.0), 2, 8, "must lie between 0"),
        ("x: 5 mm\n", lambda s: s.number("x", "force"), 1, 4, "'mm' is no unit of force: N, mN"),
        ("x: -120\n", lambda s: s.number("x", "length"), 1, 4, "'-120' lacks a unit: a length is given in m"),
        ("x: 1 2 3\n", lambda s: s.vector("x", 3, "length"), 1, 4, "3 numbers and a unit"),
        ("x: wide\n", lambda s: s.number("x", "length"), 1, 4, "write a number and a unit, such as '1 m'"),
        ("x: .inf\n", lambda s: s.number("x"), 1, 4, "not a number"),
        ("a: 1\nx: {}\n", lambda s: s.number("x"), 2, 4, "single value, not a mapping"),
        ("a: 1\n", lambda s: s.text("robot"), 1, 1, "needs 'robot'"),
        ("x: [1, 2]\n", lambda s: s.vector("x", 3), 1, 4, "list of 3 numbers"),
        ("x: [1, q]\n", lambda s: s.vector("x", 2), 1, 4, "'q' is not a number"),
        ("x: 2.5\n", lambda s: s.integer("x"), 1, 4, "whole number"),
        ("x: [3, 1]\n", lambda s: s.span("x"), 1, 4, "from 3 down to 1"),
        ("x: 3..1\n", lambda s: s.span("x"), 1, 4, "from 3 down to 1"),
        ("x: 1..\n", lambda s: s.span("x"), 1, 4, "'' is not a number"),
        ("x: reel\n", lambda s: s.choice("x", ("real", "mock")), 1, 4, "did you mean 'real'"),
        ("x: nowhere.xml\n", lambda s: s.file("x"), 1, 4, "does not exist"),
        ("x: 1\n", lambda s: s.section("x"), 1, 4, "must be a mapping"),
        ("x: [1]\n", lambda s: s.sections("x"), 1, 4, "list of mappings"),
        ("x: 1\nx: 2\n", lambda s: s, 2, 1, "written twice"),
        ("x: '{plaec}'\noptions: {place: 3}\n", lambda s: s.text("x"), 1, 4, "did you mean 'place'"),
        ("y: 1\nwdith: 2\n", lambda s: (s.has("width"), s.text("y"), s.finish()), 2, 1, "did you mean 'width'"),
    ],
)
def test_a_wrong_value_is_reported_at_its_place(read, text, ask, line, column, says):
    with pytest.raises(CellFileError) as error:
        ask(read(text))
    assert place(error) == (line, column)
    assert says in str(error.value)
    assert f"cell.yaml:{line}:{column}: error[cell]" in str(error.value)


@pytest.mark.parametrize("text", ["a: [1\n", "a: b: c\n", "\t- x\n", "a: 'open\n", "- 1\n", "", "&x *x", "42"])
def test_broken_yaml_is_one_clear_error(read, text):
    with pytest.raises(CellFileError):
        read(text)


def test_a_missing_file_and_a_folder_and_noise_are_clear_errors(tmp_path):
    (tmp_path / "noise").write_bytes(b"\xff\xfe\x00\x01")
    for path in (tmp_path / "none.yaml", tmp_path, tmp_path / "noise"):
        with pytest.raises(CellFileError, match=r"cannot be read|not YAML"):
            read_cell_file(path)


def test_options_fill_in_and_are_overridden(read, tmp_path):
    text = "options: {place: 3, skin: any}\nworld: {place: '{place}', note: 'place {place}, {skin}'}\n"
    assert read(text).section("world").text("place") == "3"
    world = read(text, {"place": "5"}).section("world")
    assert world.integer("place") == 5
    assert world.text("note") == "place 5, any"
    assert cell_options(tmp_path / "cell.yaml") == {"place": "3", "skin": "any"}


def test_an_unknown_override_names_the_options(read):
    with pytest.raises(CellFileError, match="did you mean 'place'"):
        read("options: {place: 3}\n", {"plaec": "5"})
    with pytest.raises(CellFileError, match="known: none"):
        read("name: x\n", {"place": "5"})
