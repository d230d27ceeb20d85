"""`pomona fmt` has one form: content and comments stay, and a second run changes nothing."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import yaml

from pomona.executive.cli import main
from pomona.tools.editor.format import FormatError, formatted

FOLDER = Path(__file__).resolve().parents[4]
SHIPPED = sorted([*(FOLDER / "trees").rglob("*.yaml"), *(FOLDER / "benchmarks").glob("*.yaml")])

UNTIDY = """
pomona: 1
tree:   t


root:
    sequence:
    # the first
    - MoveTo: { pose: home,speed: 3 }   # a note
      name: X
    -   wait: 1 s # short
        timeout: 3 s


    # the second
    - fallback:
            - Beep: {}
            # inside
            - check: "{a} >
                3"
            - description: |
                 two
                   lines
              Beep: {}
    - parallel:
      - Beep: {times: 2,
               loud: true}
"""

TIDY = """\
pomona: 1
tree:   t

root:
  sequence:
    # the first
    - MoveTo: {pose: home, speed: 3}   # a note
      name: X
    - wait: 1 s  # short
      timeout: 3 s

    # the second
    - fallback:
        - Beep: {}
        # inside
        - check: "{a} >
            3"
        - description: |
             two
               lines
          Beep: {}
    - parallel:
        - Beep: {times: 2,
                 loud: true}
"""


def test_one_way_to_write():
    assert formatted(UNTIDY) == TIDY
    assert formatted(TIDY) == TIDY


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_files_are_formatted(path):
    assert formatted(path.read_text()) == path.read_text()


def random_file(rng: random.Random) -> str:
    """A file of random depth, indentation, spacing, comments, quotes and blank lines."""
    lines: list[str] = []

    def noise(indent: int) -> None:
        for _ in range(rng.choice((0, 0, 0, 1, 2))):
            lines.append(
                rng.choice(("", "   ", " " * indent + "# " + rng.choice(("why", "a: b", "- x"))))
            )

    def end() -> str:
        return rng.choice(("", "", " # it", "   # {so}  ", " "))

    def flow(depth: int) -> str:
        if depth == 0:
            return rng.choice(("home", "3 mm", '"{x}"', "'#'", "0.5"))
        gap, inner = rng.choice(("", " ")), [flow(depth - 1) for _ in range(rng.randrange(1, 3))]
        if rng.random() < 0.5:
            return "[" + gap + rng.choice((",", ", ", " , ")).join(inner) + gap + "]"
        return (
            "{"
            + gap
            + ", ".join(f"k{n}:{' ' * rng.randrange(1, 4)}{v}" for n, v in enumerate(inner))
            + gap
            + "}"
        )

    def mapping(indent: int, depth: int, first: str) -> None:
        for number in range(rng.randrange(1, 4)):
            lead = first if number == 0 else " " * indent
            if number:
                noise(indent)
            kind = rng.randrange(5) if depth else rng.randrange(3)
            if kind == 0:
                lines.append(f"{lead}key{number}: {flow(2)}{end()}")
            elif kind == 1:
                lines.append(f'{lead}key{number}: "{{a}} >{end().replace("#", "")}')
                lines.append(" " * (indent + rng.randrange(1, 5)) + '3"' + end())
            elif kind == 2:
                lines.append(f"{lead}key{number}:  word{end()}")
            elif kind == 3:
                lines.append(f"{lead}key{number}:{end()}")
                mapping_at = indent + rng.randrange(1, 6)
                noise(mapping_at)
                mapping(mapping_at, depth - 1, " " * mapping_at)
            else:
                lines.append(f"{lead}key{number}:{end()}")
                at = indent + rng.randrange(0, 5)
                for _ in range(rng.randrange(1, 4)):
                    noise(at)
                    dash = " " * at + "-" + " " * rng.randrange(1, 4)
                    if rng.random() < 0.3:
                        lines.append(dash + flow(1) + end())
                    else:
                        mapping(len(dash), depth - 1, dash)

    mapping(0, 3, "")
    return "\n".join(lines) + rng.choice(("", "\n", "\n\n"))


@pytest.mark.slow
def test_a_thousand_random_files_say_the_same_and_a_second_time_changes_nothing():
    rng = random.Random(1)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    for _ in range(1000):
        text = random_file(rng)
        once = formatted(text)
        assert formatted(once) == once, text
        assert yaml.load(once, loader) == yaml.load(text, loader), text
        assert once.count("#") == text.count("#"), text


def test_a_file_that_is_no_yaml_is_left_alone():
    with pytest.raises(FormatError):
        formatted("a: [1, 2\nb: 3")


def test_the_command(tmp_path, capsys):
    path = tmp_path / "t.yaml"
    path.write_text(UNTIDY)
    assert main(["fmt", "--check", str(path)]) == 1
    assert path.read_text() == UNTIDY
    assert main(["fmt", str(path)]) == 0
    assert path.read_text() == TIDY
    assert main(["fmt", "--check", str(path)]) == 0
    path.write_text("a: [")
    assert main(["fmt", str(path)]) == 2
    assert "Nothing was changed" in capsys.readouterr().err


def test_a_time_has_a_space_before_its_unit_and_other_words_stay() -> None:
    text = "pomona: 1\ntree: t\nroot:\n  Beep: {name: 5s, times: 3}\n  timeout: 5s\n"
    assert formatted(text) == text.replace("timeout: 5s", "timeout: 5 s")


def test_values_in_one_column_stay_aligned() -> None:
    text = "parameters:\n  height: 1\n  mu:     2\nroot:   x\n"
    assert formatted(text) == text.replace("root:   x", "root: x")
