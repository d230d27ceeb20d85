"""Failed runs as one page that can be sent."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

import pytest
from recorded_events import REASON, SUCCEEDED, everything, pose, started, write

from executive.cli import main
from executive.recording.scan import scan
from executive.running.events import NodeChanged, Published, RunEnded
from executive.views import ImageView

EVIL = "<script>alert('x')</script>"


def test_a_page_shows_each_failure_with_its_reason_and_its_last_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    write(runs / "2026-01-01_a", tuple(everything()))
    write(runs / "2026-01-02_b", SUCCEEDED)
    reason = type(REASON)("a/Plan", "NO_PATH", EVIL, {})
    write(
        runs / "2026-01-03_c", (started(run="c", tree=EVIL), RunEnded(1.0, 50, "failure", reason, 50, 1.0, 2.0, None))
    )
    page = tmp_path / "failures.html"
    assert main(["runs", "failures", str(page), "--record", str(runs)]) == 0
    assert "2 failures" in capsys.readouterr().out
    text = page.read_text()
    assert "2 failed of 3 runs" in text
    assert "<code>NO_PATH</code> 2" in text
    assert "there is no path" in text
    (image,) = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', text)
    content = next(
        content for topic, content in scan(runs / "2026-01-01_a" / "run.mcap") if topic == "/images/detection"
    )
    assert unescape(image).encode() in content
    assert "<script" not in text.lower()
    assert unescape(text).count(EVIL) >= 1
    assert not re.findall(r'(?:src|href)="(?!data:)', text)  # it needs nothing else


def test_only_the_last_pictures_are_taken_and_a_file_that_is_there_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    view = next(e.value for e in everything() if isinstance(e, Published) and isinstance(e.value, ImageView))
    looks = [Published(0.1 * k, k, "a", f"look {k}", view) for k in range(1, 5)]
    end = RunEnded(1.0, 50, "failure", REASON, 50, 1.0, 2.0, {"T_base_fruit": pose(0.9)})
    write(runs / "one", (started(), *looks, NodeChanged(0.9, 45, "a/Plan", "FAILURE", "no path", 1, REASON), end))
    page = tmp_path / "failures.html"
    command = ["runs", "failures", str(page), "--record", str(runs)]
    assert main(command) == 0
    assert re.findall(r'alt="([^"]+)"', page.read_text()) == ["look 3", "look 4"]
    before = page.read_bytes()
    assert main(command) == 2
    assert "is there already" in capsys.readouterr().err
    assert page.read_bytes() == before
    assert main(["runs", "failures", str(tmp_path / "x.html"), "apple_1", "--record", str(runs)]) == 2
    assert "no run" in capsys.readouterr().err
