"""Damaged records through every command's reader, and messages through the dashboard's decoder, in one process.

    python tests/executive/recording/fuzz_records.py records --cases 1000000 --seed 1
    python tests/executive/recording/fuzz_records.py messages --cases 1000000 --seed 1

A case of `records` breaks the bytes of a good file: most of them as they come, so that checksums must find it, some
within a chunk whose checksum is corrected, so that the code behind it must bear any contents. Files stand in memory:
the readers' one way to open a record's file is replaced. A case of `messages` breaks one request to act or to start, or
one message of a record on its way to a browser. The result must be an error in words; an event that was not recorded
must never be read from a file with wrong checksums.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import io
import itertools
import json
import random
import struct
import sys
import tempfile
import time
import traceback
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from py_trees.common import Status

from pomona.executive.cell.cell import dry_cell
from pomona.executive.encode import encoded
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.language import build, read
from pomona.executive.reasons import Reason
from pomona.executive.recording import (
    overview as overview_module,
    recorder as recorder_module,
    scan as scan_module,
)
from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.mcap_file import HEAD, MAGIC
from pomona.executive.recording.message import message_of
from pomona.executive.recording.plain_file import parse, parse_object
from pomona.executive.recording.read import event_from, read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.scan import examine
from pomona.executive.registry import Registry
from pomona.executive.running.events import (
    AttemptEnded,
    Event,
    NodeChanged,
    OperatorActed,
    Published,
    RunEnded,
    RunStarted,
)
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.executive.terminal.output import json_text, visible
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.summary import Summary
from pomona.executive.views import Line3, SceneView, SeriesView, TableView
from pomona.tools.dashboard import record_messages
from pomona.tools.dashboard.choices import Choices
from pomona.tools.dashboard.command_dashboard import Launcher
from pomona.tools.dashboard.control_lock import ControlLock
from pomona.tools.dashboard.explain import explain
from pomona.tools.dashboard.messages import encode, numbered
from pomona.tools.dashboard.presses import ButtonPresses, object_of
from pomona.tools.dashboard.record_messages import cloud, image, moment, overview
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard
from pomona.tools.library.difference import comparable, differences

HOLDER = "0123abcd"
ASKING = "pomona: 1\ntree: t\nroot:\n  sequence:\n    - ask: ready?\n    - wait: 20 ms\n"
SLOW = 10.0
"""Seconds after which a case counts as a hang: one takes a millisecond."""
FORGED, DEEPER = 0.04, 0.01
"""Share of cases with right checksums, and of those with wrong ones that are shown to every reader all the same."""
REASON = Reason(
    "a/Plan", "NO_PATH", "there is no path", {"tries": 3}, (Reason("a/Plan", "X", "y"),)
)
NODES = (
    {"path": "a", "parent": None, "name": "a", "type": "retry"},
    {"path": "a/Plan", "parent": "a", "name": "Plan"},
)
TOKENS = (
    b"null", b"NaN", b"-Infinity", b"1e999", b"9" * 400, b"[" * 300, b"{}", b"[]", b'"\\ud800"', b"\x00", b"\xff",
    b"true", b"-1", b"0.5", b'""', b'"\x1b]0;x\x07"', b"\xe2\x80\xae", b'"causes":[', b'"t":', b'"event":"RunEnded"',
    b"\n", b"}", b'"type":"ImageView"', b'"nodes":7', b'"parent":"a"', b'"seed":{}', b",", b":",
)  # fmt: skip


def events() -> list[Event]:
    """A small run with one of everything that a reader looks at."""
    started = RunStarted(
        0.0, 0, "one", "pick", "pick.yaml", "pomona: 1\n", "abc", "sim", "simulated", "sim.yaml", "name: sim\n", 3,
        {"height": 0.15}, NODES, {"git": "0123abc"}, 1e9, 0.02, {"fruit": "apple_5"}, {},
    )  # fmt: skip
    scene = SceneView((Line3(np.eye(3), "planned path"),))
    series = SeriesView(np.array([0.5, 0.6]), {"slip speed [m/s]": np.array([0.1, np.nan])})
    return [
        started,
        NodeChanged(0.1, 5, "a/Plan", "RUNNING", "planning", 1),
        Published(0.4, 8, "a/Plan", "path", scene),
        Published(0.5, 9, "a/Plan", "grip", series),
        Published(0.5, 9, "a/Plan", "table", TableView(("a", "b"), (("1", "2"),), "sizes")),
        NodeChanged(0.6, 10, "a/Plan", "FAILURE", "no path", 1, REASON),
        AttemptEnded(0.6, 10, "a", 1, 3, False, REASON),
        OperatorActed(0.7, 11, "anna", "stop"),
        RunEnded(
            0.8, 12, "failure", REASON, 12, 0.8, 1.0, {"lifted": False, "height_gained_m": -7e-8}
        ),
    ]


def changed(content: bytes, rng: random.Random, begin: int = 0, end: int | None = None) -> bytes:
    """One to four random changes between two places."""
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        last = len(found) if end is None else min(end, len(found))
        at = rng.randrange(begin, max(last, begin + 1))
        kind = rng.randrange(6)
        if kind == 0:
            found[at : at + 1] = bytes([rng.randrange(256)])
        elif kind == 1:
            found[at : at + 1] = (
                bytes([found[at] ^ (1 << rng.randrange(8))]) if at < len(found) else b""
            )
        elif kind == 2:
            found[at : at + rng.randrange(20)] = rng.choice(TOKENS)
        elif kind == 3:
            del found[at : at + rng.randrange(1, 40)]
        elif kind == 4:
            found[at:at] = found[begin:last][: rng.randrange(200)]
        else:
            found[at : at + 8] = struct.pack(
                "<Q", rng.choice((0, 1, 2**31, 2**63, 2**64 - 1, rng.randrange(2**40)))
            )
    return bytes(found)


class Records:
    """Damaged files through the readers of every command."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "good").mkdir()
        vars(overview_module)["WHOLE"] = vars(record_messages)["WHOLE"] = (
            3  # so few events are a long record
        )
        vars(recorder_module)["WHOLE_BYTES"] = vars(record_messages)["WHOLE_BYTES"] = -1
        recorder = Recorder(folder / "good")
        for event in events():
            recorder.on_event(event)
        recorder.close()
        self.good = (folder / "good" / EVENTS_FILE).read_bytes()
        self.recorded = {repr(event) for event in read_events(folder / "good")}
        self.chunk = _chunk(self.good)
        (folder / "odd").mkdir()
        (folder / "odd" / EVENTS_FILE).write_bytes(b"")
        self.odd, self.content = folder / "odd", b""
        self.before = list(comparable(folder / "good"))
        self.screen = Screen(width=100)
        self.screen.file = io.StringIO()
        vars(scan_module)["open_plain"] = self._open

    def _open(self, _path: Path) -> io.BytesIO:
        return io.BytesIO(self.content)

    def case(self, rng: random.Random) -> None:
        """Break it, read it."""
        forged = rng.random() < FORGED
        if forged:
            self.content = _forged(self.good, self.chunk, rng)
        else:
            self.content = changed(self.good, rng)
            if rng.random() < 0.2:
                self.content = self.content[: rng.randrange(len(self.content) + 1)]
            if self.content == self.good:
                return
        try:
            state = examine(self.odd / EVENTS_FILE).state
        except UsageError:
            state = "unreadable"
        if not forged and state == "whole":
            raise AssertionError("a changed file passes its checks")
        if state in ("damaged", "unreadable") and rng.random() > DEEPER:
            return
        self._read_all(rng, forged)

    def _read_all(self, rng: random.Random, forged: bool) -> None:
        for kept in (
            record_messages._checked,
            record_messages._overview_of,
        ):  # another file at the same place
            kept.cache_clear()
        found = digest(self.odd)
        read = []
        try:
            for event in read_events(self.odd):
                read.append(event)
        except UsageError:
            if found.state == "ended" and not forged:
                raise AssertionError("the list believes what a reader refuses") from None
        if not forged and not {repr(event) for event in read} <= self.recorded:
            raise AssertionError("an event was read that nobody has recorded")
        self._tell(read)
        reading: tuple[Callable[[], object], ...] = (
            lambda: list(itertools.islice(differences(self.before, comparable(self.odd)), 1)),
            lambda: list(overview(self.odd, "/images/")),
            lambda: list(moment(self.odd, "/images/", 0.5, 1.0)),
            lambda: image(self.odd, f"{rng.choice((0, 400_000_000, 2**63))}-{rng.randrange(3)}"),
            lambda: cloud(self.odd, f"{rng.choice((0, 400_000_000, 2**63))}-{rng.randrange(3)}"),
        )
        try:
            rng.choice(reading)()
        except PomonaError:
            pass
        except ValueError as error:  # what the dashboard's server tells as unreadable
            if isinstance(error, UnicodeError):
                raise

    def _tell(self, read: list[Event]) -> None:
        for paragraph in explain(read):
            visible(paragraph)
        summary = Summary()
        for event in read:
            summary.on_event(event)
        if summary.started is not None and summary.ended is not None:
            json_text(summary.as_json(None))
            if len(read) % 8 == 1:  # drawing tables is most of a case
                self.screen.file = io.StringIO()
                summary.print(self.screen, None)


def _chunk(content: bytes) -> tuple[int, int]:
    """Where the first chunk's messages begin and end."""
    at = len(MAGIC)
    while True:
        opcode, length = HEAD.unpack_from(content, at)
        if opcode == Opcode.CHUNK:
            return at + HEAD.size + 40, at + HEAD.size + length
        at += HEAD.size + length


def _forged(content: bytes, chunk: tuple[int, int], rng: random.Random) -> bytes:
    """Another text within one message of the chunk, with every length and checksum made right, and no end."""
    begin, end = chunk
    places, at = [], begin
    while at < end:
        opcode, length = HEAD.unpack_from(content, at)
        if opcode == 0x05:
            places.append((at, length))
        at += HEAD.size + length
    at, length = rng.choice(places)
    text = content[at + HEAD.size + 22 : at + HEAD.size + length]
    text = changed(text, rng, rng.choice((0, min(22, len(text) - 1))))
    head = content[at + HEAD.size : at + HEAD.size + 22]
    message = HEAD.pack(0x05, len(text) + 22) + head + text
    records = content[begin:at] + message + content[at + HEAD.size + length : end]
    times = content[begin - 40 : begin - 24]
    body = (
        times
        + struct.pack("<QII", len(records), zlib.crc32(records), 0)
        + struct.pack("<Q", len(records))
        + records
    )
    return content[: begin - 40 - HEAD.size] + HEAD.pack(Opcode.CHUNK, len(body)) + body


class Messages:
    """Single messages: those of a record on their way to a browser, and those of a browser on their way here."""

    def __init__(self, _folder: Path) -> None:
        self.good = [encoded(message_of(event)) for event in events()]
        self.desk = Desk()

    def case(self, rng: random.Random) -> None:
        """Break one, decode it."""
        if rng.random() < 0.4:
            self.desk.case(rng)
            return
        content = changed(rng.choice(self.good), rng)
        try:
            json.loads(numbered(parse_object(content), 1), parse_constant=_no_constant)
            event = event_from(parse_object(content))
        except (PomonaError, ValueError):
            return
        text = encode(event, 1).encode(errors="replace")
        json.loads(text, parse_constant=_no_constant)
        parse(text)


class Desk:
    """Messages of pages: presses to a run that waits at a question, and orders to start one."""

    def __init__(self) -> None:
        document = read(ASKING, "asking.yaml")
        self.runner = Runner(
            lambda context, board: build(document, Registry({}), context=context, board=board),
            dry_cell(),
            EventStream(),
        )
        for asked in self.runner.tree.questions.values():
            asked.ask()
            asked.status = Status.RUNNING
        self.path = next(iter(self.runner.tree.questions))
        self.lock = ControlLock()
        self.lock.serve(self.runner)
        self.presses, self.loop = ButtonPresses(self.lock), asyncio.new_event_loop()
        self.launcher = Launcher(
            Dashboard(Access("127.0.0.1", 0), Path("none")), Path("none"), Choices.installed()
        )
        acts = [
            (action, "")
            for action in ("take", "release", "pause", "resume", "step", "stop", "acknowledge")
        ]
        acts += [
            ("safe_stop", ""),
            ("break", self.path),
            ("unbreak_after", self.path),
            ("fail", "arm link"),
        ]
        acts += [("answer", f"yes ← {self.path}"), ("change", f"duration = 20 ms ← {self.path}")]
        press = {"press": "p", "viewer": HOLDER, "who": "anna", "pressed": 1.5}
        self.requests = [
            json.dumps(press | {"action": action, "detail": detail}) for action, detail in acts
        ]
        form = {
            "tree": "pick_apple",
            "cell": "sim",
            "seed": 3,
            "settings": {"fruit": "apple_1"},
            "dry": False,
        }
        self.requests.append(
            json.dumps(form | {"pace": "real", "after_cut": "", "viewer": HOLDER, "who": "anna"})
        )

    def case(self, rng: random.Random) -> None:
        """Break one, send it. Without control nothing but a safe stop is ever asked of the run."""
        request = rng.choice(self.requests).replace('"p"', json.dumps(str(rng.random())), 1)
        said = object_of(changed(request.encode(), rng).decode(errors="replace"))
        if rng.random() < 0.9:
            said.pop("pressed", None)  # it would be too late
        holds = rng.random() < 0.5
        self.lock.take(HOLDER if holds else "somebody", "bert")
        with contextlib.suppress(PomonaError):
            self.launcher._order(said)
        self._asked()
        try:
            answer = self.loop.run_until_complete(self.presses.answer(said))
            json.loads(json.dumps(answer), parse_constant=_no_constant)
        except PomonaError:
            pass
        allowed = {"safe_stop", "take"} if not holds else None
        asked = self._asked()
        if allowed is not None and not asked <= allowed:
            raise AssertionError(f"{asked - allowed} was asked for without control")

    def close(self) -> None:
        """Leave no thread behind."""
        self.loop.close()
        self.launcher._dashboard.close()
        self.runner.close()

    def _asked(self) -> set[str]:
        found = set()
        while not self.runner._commands.empty():
            found.add(self.runner._commands.get()[0])
        return found


def _no_constant(word: str) -> None:
    raise AssertionError(f"{word} stops a browser")


def fuzz(kind: str, cases: int, seed: int, folder: Path) -> Iterator[str]:
    """Try a number of cases; return the failures, with the case that repeats each."""
    with contextlib.ExitStack() as stack:
        tried = {"records": Records, "messages": Messages}[kind](folder)
        if isinstance(tried, Messages):
            stack.callback(tried.desk.close)
        for case in range(cases):
            rng = random.Random(f"{kind}/{seed}/{case}")
            began = time.process_time()
            try:
                tried.case(rng)
            except Exception:
                yield f"case {kind}/{seed}/{case}\n{traceback.format_exc()}"
            if (took := time.process_time() - began) > SLOW:
                yield f"case {kind}/{seed}/{case} took {took:.1f} s of processor time"


def main() -> int:
    """Fuzz; exit status 1 when something broke."""
    parser = argparse.ArgumentParser()
    parser.add_argument("kind", choices=("records", "messages"))
    parser.add_argument("--cases", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    began, broken = time.perf_counter(), 0
    shm = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=shm if shm.is_dir() else None) as folder:
        for finding in fuzz(options.kind, options.cases, options.seed, Path(folder)):
            broken += 1
            sys.stdout.write(f"{finding}\n")
            if broken >= 5:
                break
    took = time.perf_counter() - began
    sys.stdout.write(
        f"{options.kind}: {options.cases} cases, {broken} findings, {options.cases / took:.0f} a second\n"
    )
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
