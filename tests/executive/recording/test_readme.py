"""The README of recording follows one event: its topics are those that it lists, and the event comes back."""

from __future__ import annotations

import re
from pathlib import Path

from mcap.reader import make_reader

from pomona.executive import recording
from pomona.executive.reasons import Reason
from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import events_file
from pomona.executive.recording.message import in_place_of, message_of
from pomona.executive.recording.read import event_from, read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.scan import examine
from pomona.executive.recording.session import unfinished
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


def test_every_file_and_function_that_is_named_exists() -> None:
    files = set(re.findall(r"(?<![\w/`.])(\w+\.py)", PAGE))
    assert files == {path.name for path in FOLDER.glob("*.py")} - {"__init__.py"}
    for function in (digest, event_from, examine, in_place_of, message_of, read_events, unfinished):
        assert f"`{function.__name__}`" in PAGE


def test_the_page_is_short() -> None:
    assert len(re.findall(r"\S*[a-zA-Z]\S*", PAGE)) <= 400
