"""The camera after each pick of a run: a sentence on the terminal and on the page.

Its words come from the picks of this run and of those before it. They are no events of the run: a record has the
touches, and `pomona explain` computes the same from them.
"""

from __future__ import annotations

import argparse
import contextlib
import queue
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pomona.executive.cell.cell_file import CellFile
from pomona.executive.encode import plain
from pomona.executive.errors import PomonaError
from pomona.executive.execute import RunOrder
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.run_views import RunView, ViewedRun
from pomona.executive.running.events import Event, Published, RunEnded, RunStarted
from pomona.executive.terminal.screen import Screen
from pomona.executive.views import TableView

NOTED = "touches.json"  # file in a record's folder with its touches, so that they are not looked for in every start
TOPIC = "camera"  # of the page's table
LONGEST = 10.0  # longest wait for the words about the last pick, after the run [s]


class TouchesView(RunView):
    """Words about the camera after each pick."""

    files = (NOTED,)
    _console: Screen
    _others: Sequence[RunView]
    _words: CameraWords

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        if getattr(options, "dry", None) is not None:
            return False
        self._console = run.console
        self._others = run.opened
        self._words = CameraWords(run.records)
        self._at = 0.0, 0
        return True

    def admit(self, order: RunOrder, cell: CellFile) -> RunOrder:
        from pomona.tools.caliper.admission import admit

        return admit(order, cell)

    def explain(self, record: Path) -> str:
        from pomona.tools.caliper.explain import explain

        return explain(record)

    def on_event(self, event: Event) -> None:
        self._at = event.t, event.tick
        if isinstance(event, RunStarted):
            self._words.begin(event)
        elif isinstance(event, Published) and event.topic in ("touches", "doubted_look"):
            self._words.take(event.t, event.value)
        elif not isinstance(event, RunEnded):
            self._show()

    def ended(self, problem: str) -> None:
        self._words.wait(LONGEST)
        self._show()

    def close(self) -> None:
        self._words.close()

    def _show(self) -> None:
        for is_off, sentence in self._words.ready():
            self._console.print(sentence, style="yellow" if is_off else None)
            table = TableView(
                ("camera",), ((sentence,),), "the camera, from the touches of the pads"
            )
            for view in self._others:
                with contextlib.suppress(PomonaError):  # a page that is lost ends the run by itself
                    view.on_event(Published(*self._at, "", TOPIC, table))


class _Picked(NamedTuple):
    """The touches of a run up to its newest pick, with the cell's name and digest."""

    run: str
    cell: tuple[str, str]
    own: tuple[tuple[str, Any], ...]


class CameraWords:
    """Words about the camera, made in a thread of their own."""

    def __init__(self, records: Path) -> None:
        """Take the folder of records, in which runs before this one are looked for."""
        self._records = records
        self._run = ""
        self._cell = "", ""
        self._own: list[tuple[str, Any]] = []
        self._picks: queue.SimpleQueue[_Picked | None] = queue.SimpleQueue()
        self._ready: queue.SimpleQueue[tuple[bool, str]] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="pomona-caliper", daemon=True)
        self._begun = False

    def begin(self, event: RunStarted) -> None:
        """Take the start of the run; a recovery may have come before it."""
        from pomona.tools.caliper.records import values_of

        if self._begun:
            self.close()
            self._own = []
        else:
            self._thread.start()
        self._run, self._cell = (
            event.run,
            (event.cell, values_of(event.cell_text, *event.cell_files.values())),
        )
        self._begun = True

    def take(self, t: float, touches: object) -> None:
        """Take the touches of a pick at a time of the run [s]; returns at once."""
        self._own.append((f"{self._run} at {t:.2f} s", plain(touches)))
        self._picks.put(_Picked(self._run, self._cell, tuple(self._own)))

    def ready(self) -> list[tuple[bool, str]]:
        """Return the words about the picks since the last call, and whether the camera is off."""
        found = []
        with contextlib.suppress(queue.Empty):
            while True:
                found.append(self._ready.get_nowait())
        return found

    def wait(self, longest: float) -> None:
        """Wait until the last pick has its words, at most so long [s]."""
        self._picks.put(None)
        if self._begun:
            self._thread.join(longest)

    def close(self) -> None:
        """Note the touches beside the record of the run, so that the next run need not look for them."""
        from pomona.tools.caliper.records import note_touches

        record = self._records / self._run
        if self._begun and self._run and (record / EVENTS_FILE).is_file():
            note_touches(record, *self._cell, self._own)

    def _work(self) -> None:
        from pomona.tools.caliper.estimate import estimate
        from pomona.tools.caliper.explain import describe_widths
        from pomona.tools.caliper.findings import find_error
        from pomona.tools.caliper.records import Picks, read_back, records_before

        past: list[Path] | None = None
        said = set[str]()  # reasons: eight landings on one fruit need no eight sentences
        while (picked := self._picks.get()) is not None:
            run = picked.run
            name = picked.own[-1][0]
            read = Picks.of_run(run, *picked.cell, picked.own)
            if read.refused and read.refused[-1].startswith(name):
                reason = read.refused[-1].partition(": ")[2]
                if reason not in said:
                    self._ready.put((False, f"No word about the camera: {reason}."))
                said.add(reason)
                continue
            if past is None:
                past = [other for other in records_before(self._records) if other.name != run]
            read_back(past, read, noted=True)
            found = estimate(read.picks)
            finding = find_error(found)
            last = [pick for pick in read.picks if pick.name == name]
            words = filter(None, (finding.sentence, describe_widths(last, found)))
            self._ready.put((finding.is_off, " ".join(words)))
