"""Actions of operators in a record."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.writer import CompressionType
from recorded_events import SUCCEEDED, write

from pomona.executive.cli import main
from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.mcap_file import LIBRARY
from pomona.executive.recording.recorder import new_writer
from pomona.executive.recording.scan import scan
from pomona.executive.recording.well_known import INTERVENTIONS
from pomona.executive.running.events import OperatorActed

ACTS = tuple(
    OperatorActed(0.5 * n, 25 * n, "anna", action)
    for n, action in enumerate(("take", "pause", "resume"))
)


def test_a_record_holds_and_shows_the_actions_of_operators(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = write(tmp_path / "run", (SUCCEEDED[0], *ACTS, SUCCEEDED[1]))
    entries = [
        json.loads(found.content)
        for found in scan(folder / EVENTS_FILE, topics=INTERVENTIONS.__eq__)
    ]
    assert entries[1] == {"t": 0.5, "tick": 25, "who": "anna", "action": "pause", "detail": ""}
    assert len(entries) == len(ACTS)
    assert main(["runs", "show", str(folder)]) == 0
    assert "0.00 s anna: take  0.50 s anna: pause  1.00 s anna: resume" in capsys.readouterr().out


def test_a_record_with_the_chained_log_of_an_earlier_version_opens(tmp_path: Path) -> None:
    path = write(tmp_path / "run", (SUCCEEDED[0], *ACTS, SUCCEEDED[1])) / EVENTS_FILE
    found = list(scan(path))
    with path.open("wb") as output:
        writer = new_writer(output, CompressionType.NONE)
        writer.start(profile="pomona", library=LIBRARY)
        channels: dict[str, int] = {}
        for topic, content, stamp, _sequence in found:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            if topic == INTERVENTIONS:
                content = b'{"number":1,"before":"%b","closed":false,%b' % (b"0" * 64, content[1:])
            writer.add_message(channels[topic], stamp, content, stamp)
        writer.finish()
    assert digest(path.parent).state == "ended"
    assert main(["explain", str(path.parent)]) == 0
