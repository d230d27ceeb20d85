"""`pomona calibrate sizes`, from tables of finds to a block that a fruit file includes."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from pomona.executive.cli import main
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.fruit.sizes import KindSizes

KIND = KindSizes(0.073, 0.07, 0.957, 0.06, looks=1.05, looks_deviation=0.03)
APPLE = Path("trees/fruits/apple").absolute()


def finds(count: int, seed: int = 0, looks: int = 1) -> list[dict[str, str]]:
    """Rows of fruit drawn from a kind, each seen from several sides, measured by hand and by shape."""
    rng = np.random.default_rng(seed)
    fruit = load_fruit("apple")
    model = float(fruit.dimensions[1] / fruit.dimensions[[0, 2]].mean())
    rows = []
    for number in range(1, count + 1):
        width = np.log(KIND.width) + KIND.width_deviation * rng.normal()
        ratio = np.log(KIND.height_over_width) + KIND.height_over_width_deviation * rng.normal()
        for _ in range(looks):
            sine = rng.uniform(0.0, 1.0)
            seen = width + 0.5 * sine**2 * (ratio - np.log(model)) + np.log(KIND.looks)
            shown = np.exp(seen + np.hypot(0.02, KIND.looks_deviation) * rng.normal())
            high = width + ratio
            rows.append(
                {
                    "fruit": str(number), "scene": "1", "method": "shape+plane", "from_side": f"{sine:.3f}",
                    "shown_mm": f"{1e3 * shown:.2f}", "shown_90_mm": f"{1e3 * 0.02 * 1.645 * shown:.2f}",
                    "width_mm": f"{1e3 * np.exp(width + 0.02 * rng.normal()):.1f}",
                    "height_mm": f"{1e3 * np.exp(high + 0.02 * rng.normal()):.1f}",
                    "width_90_mm": f"{1e3 * 0.02 * 1.645 * np.exp(width):.1f}",
                    "height_90_mm": f"{1e3 * 0.02 * 1.645 * np.exp(high):.1f}",
                    "true_width_mm": f"{1e3 * np.exp(width):.1f}", "true_height_mm": f"{1e3 * np.exp(high):.1f}",
                }
            )  # fmt: skip
    return rows


def write(rows: Sequence[dict[str, str]], file: Path = Path("finds.csv")) -> str:
    with file.open("w", newline="") as out:
        writer = csv.DictWriter(out, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return str(file)


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("how", [(), ("--by-shape",)], ids=["by hand", "by shape"])
def test_learnt_values_are_those_that_a_fruit_file_includes(how, capsys) -> None:
    assert main(["calibrate", "sizes", write(finds(400)), "--out", "sizes.yaml", *how]) == 0
    assert capsys.readouterr().out.startswith("400 fruit: width 7")
    text = (APPLE / "fruit.yaml").read_text().replace("apple.ply", str(APPLE / "apple.ply"))
    text = text.replace("stem.ply", str(APPLE / "stem.ply"))
    Path("fruit.yaml").write_text(text + "sizes: {include: sizes.yaml}\n")
    sizes = load_fruit(Path("fruit.yaml")).sizes
    assert sizes is not None
    assert sizes.width == pytest.approx(KIND.width, rel=0.02)
    assert sizes.width_deviation == pytest.approx(KIND.width_deviation, rel=0.12)
    assert sizes.height_over_width == pytest.approx(KIND.height_over_width, rel=0.02)
    assert sizes.height_over_width_deviation == pytest.approx(
        KIND.height_over_width_deviation, rel=0.15
    )
    assert sizes.looks == pytest.approx(KIND.looks, rel=0.02)
    assert sizes.looks_deviation == pytest.approx(KIND.looks_deviation, abs=0.01)


def test_looks_at_one_fruit_are_one_fruit(capsys) -> None:
    assert main(["calibrate", "sizes", write(finds(10, looks=3)), "--out", "sizes.yaml"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("10 fruit: ")
    assert "each fruit with the sizes of the others" in said


def test_tables_of_two_places_are_added_up(capsys) -> None:
    tables = write(finds(10)), write(finds(10, seed=1), Path("others.csv"))
    assert main(["calibrate", "sizes", *tables, "--out", "sizes.yaml"]) == 0
    assert capsys.readouterr().out.startswith("20 fruit: ")


def without(rows: list[dict[str, str]], name: str) -> list[dict[str, str]]:
    return [{key: value for key, value in row.items() if key != name} for row in rows]


def spoilt(rows: list[dict[str, str]], **values: str) -> list[dict[str, str]]:
    return [*rows[:3], {**rows[3], **values}, *rows[4:]]


@pytest.mark.parametrize(
    ("spoil", "how", "words"),
    [
        (
            lambda rows: rows[:4],
            (),
            "4 measured fruit do not give the spread of sizes: measure 7 or more",
        ),
        (
            lambda rows: rows[:6],
            (),
            "6 measured fruit do not give the spread of sizes: measure 7 or more",
        ),
        (lambda rows: without(rows, "fruit"), (), "no column fruit"),
        (
            lambda rows: spoilt(rows, true_width_mm="7.1"),
            (),
            "finds.csv:5: true_width_mm is 7.1, but the camera saw",
        ),
        (
            lambda rows: spoilt(rows, true_height_mm="700"),
            (),
            "finds.csv:5: true_height_mm is 700, but the camera saw",
        ),
        (
            lambda rows: spoilt(
                rows, fruit="1", true_width_mm=str(1.1 * float(rows[0]["true_width_mm"]))
            ),
            (),
            "another row of fruit 1 has",
        ),
        (lambda rows: without(rows, "true_width_mm"), (), "no column true_width_mm"),
        (lambda rows: without(rows, "shown_mm"), (), "no column shown_mm"),
        (
            lambda rows: [{**row, "true_width_mm": ""} for row in rows],
            (),
            "no row has true_width_mm",
        ),
        (lambda rows: spoilt(rows, true_width_mm="7O"), (), "finds.csv:5: true_width_mm is '7O'"),
        (
            lambda rows: spoilt(rows, true_height_mm="nan"),
            (),
            "finds.csv:5: true_height_mm is 'nan'",
        ),
        (
            lambda rows: spoilt(rows, true_height_mm="-70"),
            (),
            "finds.csv:5: true_height_mm is '-70'",
        ),
        (
            lambda rows: [{**row, "method": "uniform"} for row in rows],
            ("--by-shape",),
            "no row was measured by",
        ),
        (
            lambda rows: [{**row, "height_90_mm": "9"} for row in rows],
            ("--by-shape",),
            "no row was measured by",
        ),
        (lambda rows: rows, ("--fruit", "pear"), "pear"),
    ],
)
def test_data_without_anything_to_learn_are_refused_in_a_line_and_nothing_is_written(
    spoil: Callable[..., list[dict[str, str]]],
    how: tuple[str, ...],
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["calibrate", "sizes", write(spoil(finds(12))), "--out", "sizes.yaml", *how]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not Path("sizes.yaml").exists()


def test_no_file_is_written_over_and_a_run_without_tables_is_reported(capsys) -> None:
    Path("sizes.yaml").write_text("mine")
    assert main(["calibrate", "sizes", write(finds(12)), "--out", "sizes.yaml"]) == 2
    assert "sizes.yaml is there already" in capsys.readouterr().err
    assert Path("sizes.yaml").read_text() == "mine"
    Path("picture.csv").write_bytes(bytes(range(256)))
    assert main(["calibrate", "sizes", "picture.csv", "--out", "new.yaml"]) == 2
    assert "picture.csv: is no table" in capsys.readouterr().err
    text = Path(write(finds(12))).read_text()
    Path("parted.csv").write_text(text.replace(",", ";"))
    assert main(["calibrate", "sizes", "parted.csv", "--out", "new.yaml"]) == 2
    assert "parted.csv: its columns are not parted by commas" in capsys.readouterr().err
    Path("twice.csv").write_text(
        "".join(f"{line},{line.rpartition(',')[2]}\n" for line in text.splitlines())
    )
    assert main(["calibrate", "sizes", "twice.csv", "--out", "new.yaml"]) == 2
    assert "twice.csv: has the column true_height_mm twice" in capsys.readouterr().err
    assert main(["calibrate", "sizes", "finds.csv", "--out", "nowhere/new.yaml"]) == 2
    assert "nowhere/new.yaml: there is no folder nowhere" in capsys.readouterr().err
    assert main(["calibrate", "sizes", "nothing.csv", "--out", "new.yaml"]) == 2
    assert "nothing.csv: cannot be read: No such file or directory" in capsys.readouterr().err


def test_exchanged_width_and_height_are_found_by_the_kinds_proportions(capsys) -> None:
    rows = finds(30)
    swapped = [
        {**row, "true_width_mm": row["true_height_mm"], "true_height_mm": row["true_width_mm"]}
        for row in rows
    ]
    assert main(["calibrate", "sizes", write(swapped), "--out", "sizes.yaml"]) == 2
    assert "are true_width_mm and true_height_mm exchanged?" in capsys.readouterr().err
    assert not Path("sizes.yaml").exists()
    high = [{**row, "true_height_mm": f"{0.995 * float(row['true_width_mm']):.1f}"} for row in rows]
    assert main(["calibrate", "sizes", write(high), "--out", "sizes.yaml"]) == 0
