"""The README of recording follows one event: its topics are those that it lists, and the event comes back."""

from __future__ import annotations

import re
from pathlib import Path

from mcap.reader import make_reader

from pomona.executive import recording
from pomona.executive.reasons import Reason
from pomona.executive.recording.folder import events_file
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import NodeChanged

FOLDER = Path(recording.__file__).parent
PAGE = (FOLDER / "README.md").read_text("utf-8")
EXAMPLE = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[0]


def test_the_example_has_the_topics_that_are_listed_and_comes_back(tmp_path: Path) -> None:
    event = eval(EXAMPLE, {"NodeChanged": NodeChanged, "Reason": Reason})
    recorder = Recorder(tmp_path)
    recorder.on_event(event)
    recorder.close()
    with events_file(tmp_path).open("rb") as stream:
        topics = [channel.topic for _, channel, _ in make_reader(stream).iter_messages()]
    assert topics == re.findall(r"^\| `(/\w+)` \|$", PAGE, re.MULTILINE)
    assert list(read_events(tmp_path)) == [event]
