"""A run as one page that can be sent."""

from __future__ import annotations

import re
from base64 import b64encode
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from recorded_events import REASON, everything, pose, started, write

from pomona.executive.cli import main
from pomona.executive.execute import RunOrder, execute
from pomona.executive.recording.scan import scan
from pomona.executive.running.events import Published, RunEnded
from pomona.executive.views import ImageView, Line2, TableView
from pomona.tools.dashboard import pages

EVIL = "<script>alert('x')</script>"


def export(record: Path, page: Path) -> str:
    assert main(["runs", "export", record.name, str(page), "--record", str(record.parent)]) == 0
    return page.read_text()


def test_a_page_shows_a_failure_with_its_reason_and_needs_nothing_else(tmp_path: Path) -> None:
    record = write(tmp_path / "runs" / "one", tuple(everything()))
    text = export(record, tmp_path / "one.html")
    assert "<code>NO_PATH</code>" in text
    assert "there is no path" in text
    (image,) = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', text)
    content = next(
        content for topic, content, *_ in scan(record / "run.mcap") if topic == "/images/detection"
    )
    assert unescape(image).encode() in content
    assert not re.findall(r'(?:src|href)="(?!data:)', text)


def test_words_of_a_record_are_no_code_on_its_page(tmp_path: Path) -> None:
    reason = type(REASON)("a/Plan", "NO_PATH", EVIL, {})
    end = RunEnded(1.0, 50, "failure", reason, 50, 1.0, 2.0, None)
    text = export(write(tmp_path / "runs" / "one", (started(tree=EVIL), end)), tmp_path / "x.html")
    assert "<script" not in text.lower()
    assert unescape(text).count(EVIL) >= 2


def test_only_the_newest_pictures_are_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pages, "LOOKS", 2)
    view = next(
        e.value for e in everything() if isinstance(e, Published) and isinstance(e.value, ImageView)
    )
    looks = [Published(0.1 * k, k, "a", f"look {k}", view) for k in range(1, 5)]
    end = RunEnded(1.0, 50, "failure", REASON, 50, 1.0, 2.0, {"T_base_fruit": pose(0.9)})
    text = export(write(tmp_path / "runs" / "one", (started(), *looks, end)), tmp_path / "x.html")
    assert re.findall(r'alt="([^"]+)"', text) == ["look 3", "look 4"]


def test_a_full_disk_leaves_no_half_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    end = RunEnded(1.0, 50, "failure", REASON, 50, 1.0, 2.0, None)
    write(tmp_path / "runs" / "one", (started(), end))

    def full(path: Path, text: str, **_how: str) -> int:
        path.write_bytes(text[:100].encode())
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    monkeypatch.chdir(tmp_path)
    assert main(["runs", "export", "one", "one.html"]) == 2
    assert "one.html: No space left on device" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["runs"]


def test_a_run_becomes_a_page_with_its_tables_and_the_drawings_over_each_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    image = np.full((40, 60, 3), 90, np.uint8)
    square = np.array([[5.0, 5.0], [25.0, 5.0], [25.0, 25.0]])
    first = ImageView(image, (Line2(square, "1", "refined", closed=True),), caption=EVIL)
    second = ImageView(
        None, (*first.lines, Line2(square + 10.0, "2", "muted")), caption="a: 2 found"
    )
    table = TableView(("fruit", "not measured"), (("1", ""), ("2", EVIL)), "1 of 2 fruit measured")
    views = (
        Published(0.1, 1, "a", "overlay", first),
        Published(0.2, 2, "a", "overlay", replace(second, image=image)),
    )
    end = RunEnded(1.0, 50, "success", None, 50, 1.0, 2.0, None)
    write(runs / "one", (started(), *views, Published(0.3, 3, "a", "measured", table), end))
    picture = b"\x89PNG of the run"
    (runs / "one" / "picture.png").write_bytes(picture)
    page = tmp_path / "one.html"
    assert main(["runs", "export", "one", str(page), "--record", str(runs)]) == 0
    text = page.read_text()
    assert text.count("<h1>Events of one</h1>") == 1
    brief, rest = text.split("<details><summary>Every moment</summary>")
    assert "It succeeded" in brief  # what happened, in sentences; the rest is folded
    assert "It took 1.0 s simulated" in rest.split("</details>")[0]
    assert f"data:image/png;base64,{b64encode(picture).decode()}" in text
    assert text.count("<img ") == 2  # the run's own, and a look once, with what was drawn last
    assert text.count("<path ") == 2
    assert 'viewBox="0 0 60 40"' in text
    assert "M5.0 5.0L25.0 5.0L25.0 25.0Z" in text
    assert "1 of 2 fruit measured" in text
    assert "<td>&lt;script&gt;" in text
    assert "<script" not in text.lower()
    before = page.read_bytes()
    assert main(["runs", "export", "one", str(page), "--record", str(runs)]) == 2
    assert "exists, and nothing" in capsys.readouterr().err
    assert page.read_bytes() == before
    assert (
        main(
            [
                "runs",
                "export",
                "one",
                str(tmp_path / "frames"),
                "--to",
                "frames",
                "--record",
                str(runs),
            ]
        )
        == 0
    )
    assert (tmp_path / "frames" / "table_measured.csv").read_text().splitlines() == [
        "fruit,not measured", "1,", f"2,{EVIL}",
    ]  # fmt: skip


def test_a_page_has_the_tree_with_the_last_result_of_each_node(tmp_path: Path) -> None:
    tree = tmp_path / "demo.yaml"
    tree.write_text(
        "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - wait: 50 ms\n      name: Before <it>\n"
        "    - fail: {code: BLOCKED, message: it is shut}\n      name: The gate\n      retry: 2\n    - wait: 1 s\n",
        encoding="utf-8",
    )
    done = execute(RunOrder(tree, tmp_path / "cell.yaml", record=tmp_path / "runs", dry=True))
    assert done.record is not None
    page = tmp_path / "run.html"
    pages.write_run(done.record, page)
    text = page.read_text()
    boxes = re.findall(r'<g class="(\w*)"><title>([^<\n]*?)(?: \(|\n|<)', text)
    assert boxes == [
        ("bad", "sequence"),
        ("good", "Before &lt;it&gt;"),
        ("bad", "The gate"),
        ("idle", "wait"),
    ]
