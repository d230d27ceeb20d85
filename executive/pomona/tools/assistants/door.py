"""The door's tools: each judges its arguments, carries out one `pomona` command, and names the next step."""

from __future__ import annotations

import dataclasses
import json
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from pomona.executive.cell.cell_file import KINDS, SIMULATED, outline_cell
from pomona.executive.errors import UsageError
from pomona.executive.files import find_cell, find_tree
from pomona.executive.language.check import read_document, usual_cell
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.reasons import failure_codes
from pomona.executive.recording.index import RunIndex
from pomona.executive.terminal.output import json_text
from pomona.executive.values.findings import Findings, did_you_mean
from pomona.executive.values.installation import installed_trees
from pomona.tools.assistants.bounded import Answer, Commands
from pomona.tools.assistants.work_folder import WorkFolder
from pomona.tools.dashboard.approvals import STARTED_BY, Approvals, version_of

QUICK = 60.0  # limit of a command that starts no run [s]; on a loaded computer a check takes 8 s
# settings of a command, characters of a value
MOST_SETTINGS = 30
MOST_VALUE = 200
MOST_FINDINGS = 100  # in an answer
MOST_ANSWER = 60_000  # characters of a text in an answer: a drawing of 1 000 nodes has 50 000
_KEY = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")

call_number: ContextVar[int] = ContextVar("call_number", default=0)
"""Number of the call that is being answered, as in the log."""

Settings = dict[str, str]


class Door:
    """Tools for an assistant, in one folder. One command runs at a time; the others wait."""

    def __init__(
        self, folder: WorkFolder, commands: Commands, *, most_runs: int = 50, limit: float = 600.0
    ) -> None:
        """
        Args:
            most_runs: simulated runs that may be started.
            limit: of the time of a run [s].
        """
        self.folder = folder
        self._commands = commands
        self._limit = limit
        self.most_runs = most_runs
        self.runs_started = 0
        self.approvals = Approvals(folder.root, folder.records)
        self._lock = threading.Lock()

    def tools(self) -> tuple[Any, ...]:
        """Return the functions that an assistant may call; their docstrings are its help."""
        return (
            self.list_files, self.read_file, self.write_file, self.skills, self.words, self.failure_codes, self.check,
            self.show, self.dry_run, self.test, self.run, self.runs, self.explain, self.evidence, self.approve,
        )  # fmt: skip

    # ------------------------------------------------------------------------------------------- files

    def list_files(self) -> str:
        """List the YAML files of the folder, and the names of the installed trees and cells.

        Next: `read_file` shows one; an installed tree is a good example.
        """
        installed = installed_trees()
        cells = {path.stem: _kind(path) for path in sorted((installed / "cells").glob("*.yaml"))}
        trees = sorted(path.stem for path in installed.glob("*.yaml"))
        return json_text(
            {"files": self.folder.files(), "installed_trees": trees, "installed_cells": cells}
        )

    def read_file(self, path: str) -> str:
        """Read a file of the folder, or an installed tree by its name. The answer begins with the text's version.

        Next: change the text and give it to `write_file` with this version.
        """
        tree = self.folder.tree(path)
        text = self.folder.read(
            find_tree(str(self.folder.root / tree) if tree.startswith("./") else tree)
        )
        return f"version: {version_of(text)}\n{text}"

    def write_file(self, path: str, text: str, version: str = "", replace: bool = False) -> str:
        """Write a tree, a scenario or a file of mocks (.yaml) into the folder, whole or not at all.

        `version`: of the text that you have read; a file that has changed since then is not written over, unless
        `replace` is true. Leave it empty for a new file. Next: `check`.
        """
        written = self.folder.write(path, text, version, replace)
        return (
            f"{self.folder.shown(written)} is written, version {version_of(text)}. Next: check it."
        )

    # ------------------------------------------------------------------------------------------- the language

    def skills(self, name: str = "") -> str:
        """List the installed skills, or one by its name with its ports, units, ranges, help and failure codes.

        Next: `read_file` a tree that uses it, `failure_codes`, or `write_file`.

        Raises UsageError: there is none of this name.
        """
        words = ["skills", "--json", *(["--", name] if name else [])]
        found = json.loads(self._command(words, QUICK).out)
        if not name:
            return json_text({skill["name"]: skill["summary"] for skill in found})
        (skill,) = found
        codes = {code: _meaning(code) for code in skill["failures"]}
        return json_text({**skill, "failures": codes}, indent=1)

    def words(self, name: str = "") -> str:
        """List the words of the tree language, or one by its name with the words that may stand beside it.

        Next: `read_file` a tree, or `write_file`.

        Raises UsageError: there is none of this name.
        """
        types = NodeTypes.installed()
        if not name:
            return json_text(
                {word: f"{found.role}: {found.summary}" for word, found in types.items()}
            )
        found = types.get(name)
        if found is None:
            raise UsageError(
                f"no word '{name[:60]}'; {did_you_mean(name, types) or 'call words without a name'}"
            )
        beside = {slot: field.help or type(field).__name__ for slot, field in found.slots.items()}
        return json_text(
            {"word": name, "role": found.role, "summary": found.summary, "takes": beside}, indent=1
        )

    def failure_codes(self, code: str = "") -> str:
        """List the failure codes with their meanings, or one with its meaning and remedy.

        Raises UsageError: there is none of this name.
        """
        codes = failure_codes()
        if not code:
            return json_text({name: about.meaning for name, about in codes.items()})
        if code not in codes:
            raise UsageError(
                f"no failure code '{code[:60]}'; {did_you_mean(code, codes) or 'call it without a code'}"
            )
        return json_text(dataclasses.asdict(codes[code]), indent=1)

    # ------------------------------------------------------------------------------------------- before a run

    def check(self, path: str, cell: str = "", settings: Settings | None = None) -> str:
        """Check a tree, a scenario or another file: every finding with line, column, severity and remedy.

        `cell`: check the tree against this cell. Next: correct the findings, then `dry_run` or `show`.

        Raises UsageError: the file cannot be read.
        """
        words = ["check", self.folder.tree(path), "--json", *self._cell(cell), *_set(settings)]
        answer = self._command(words, QUICK, (0, 2))
        try:
            found = json.loads(answer.out)
        except ValueError:
            raise UsageError(answer.problem) from None
        keys = ("path", "line", "column", "severity", "code", "message", "hint", "excerpt")
        errors = sum(finding["severity"] == "error" for finding in found)
        following = (
            "correct the errors, then check again" if errors else "dry_run, or test a scenario"
        )
        findings = [
            {key: finding[key] for key in keys if finding[key]} for finding in found[:MOST_FINDINGS]
        ]
        more = {"left out": len(found) - MOST_FINDINGS} if len(found) > MOST_FINDINGS else {}
        return json_text(
            {"errors": errors, "findings": findings, **more, "next": following}, indent=1
        )

    def show(self, tree: str) -> str:
        """Draw a tree as text. Next: `check` or `dry_run`."""
        return _cut(self._command(["show", self.folder.tree(tree)], QUICK).out)

    def dry_run(self, tree: str, mocks: str = "", settings: Settings | None = None) -> str:
        """Run a tree without any cell: every skill is a mock, which succeeds at once or as the file `mocks` states.

        Next: `test` for other ends of the skills, `run` for the simulated cell.
        """
        given = f"--dry={self.folder.shown(self.folder.file(mocks))}" if mocks else "--dry"
        words = ["run", self.folder.tree(tree), given, "--json", "--no-record", *_set(settings)]
        return _summary(
            self._command(words, QUICK, (0, 1, 3)), "test a scenario, or run it on a simulated cell"
        )

    def test(self, scenario: str) -> str:
        """Run a scenario file: a tree with mocks, answers and expected ends; names nodes that no case has reached.

        Next: add a case for these nodes (`read_file`, `write_file`), or `run`.
        """
        return _cut(self._command(["test", self.folder.scenario(scenario)], QUICK, (0, 1)).out)

    # ------------------------------------------------------------------------------------------- runs

    def run(
        self, tree: str, cell: str = "", seed: int = 0, settings: Settings | None = None
    ) -> str:
        """Run a tree on a simulated cell (by default the installed one), recorded. A real cell is refused.

        `settings`: parameters of the tree and options of the cell. Next: `explain` the run.

        Raises UsageError: the tree, cell or settings cannot be used, or the limit of runs or time is reached.
        """
        target = self.folder.tree(tree)
        if kind := self._not_simulated(cell, tree):
            raise UsageError(
                f"the cell '{cell[:60]}' is {kind}, not simulated: `approve` asks the operator to start it"
            )
        words = [
            "run",
            target,
            "--simulated",
            "--json",
            f"--seed={seed}",
            f"--record={self.folder.records}",
        ]
        words += [*self._cell(cell), *_set(settings)]
        with self._lock:
            if self.runs_started >= self.most_runs:
                raise UsageError(
                    f"the limit of {self.most_runs} runs is reached: the operator may start the door again"
                )
            self.runs_started += 1
        answer = self._carry_out(words, self._limit)
        if record := _last_line(answer).get("record"):
            self._sign(Path(record), tree=tree, cell=cell, seed=seed, settings=settings or {})
        _refuse(answer, "run", (0, 1, 3))
        return _summary(answer, "explain the run, with whole=true for all its moments")

    def runs(self) -> str:
        """List the recorded runs, newest first, at most 100. Next: `explain` one."""
        keys = (
            "run",
            "state",
            "tree",
            "cell",
            "cell_kind",
            "seed",
            "settings",
            "outcome",
            "code",
            "message",
            "time",
        )
        found = [run.as_json() for run in RunIndex(self.folder.records).read()[:100]]
        return json_text(
            [{key: run[key] for key in keys if run[key] not in (None, "", {})} for run in found],
            indent=1,
        )

    def explain(self, run: str = "last", whole: bool = False) -> str:
        """Explain a recorded run: events, causes, remedy; with `whole` every moment. Next: change the tree."""
        words = [
            "explain",
            self.folder.record(run),
            f"--record={self.folder.records}",
            *(["--all"] if whole else []),
        ]
        return _cut(self._command(words, QUICK).out)

    def evidence(self, runs: list[str]) -> str:
        """Report hazards, their limits and the largest measured values over recorded runs.

        Raises UsageError: no record can serve as evidence.
        """
        if not 0 < len(runs) <= 100:
            raise UsageError("name 1 to 100 runs: the tool `runs` lists them")
        names = [self.folder.record(run) for run in runs]
        return self._command(
            ["evidence", *names, f"--record={self.folder.records}"], QUICK, (0, 1)
        ).out

    def approve(
        self, tree: str, cell: str, reason: str, seed: int = 0, settings: Settings | None = None
    ) -> str:
        """Ask the operator to run a tree on a cell that is not simulated. Nothing is started.

        The operator reads what has changed in tree and cell since a person ran them, and the reason, and starts the run.

        Raises UsageError: the cell is simulated, or the tree has errors on it.
        """
        if not self._not_simulated(cell, tree):
            raise UsageError(
                f"the cell '{cell[:60] or 'default'}' is simulated: `run` starts it without an approval"
            )
        checked = json.loads(self.check(tree, cell, settings))
        if checked["errors"]:
            raise UsageError(
                f"the tree has {checked['errors']} errors on this cell: `check` lists them"
            )
        target = self.folder.tree(tree)
        where = self.folder.cell(cell)
        name = self.approvals.ask(target, where, seed, settings or {}, reason, call_number.get())
        return f"request {name} is written. The operator reads it and starts the run, or does not; `runs` lists it then."

    # ------------------------------------------------------------------------------------------- inside

    def _command(self, words: Sequence[str], limit: float, good: tuple[int, ...] = (0,)) -> Answer:
        """Carry out a command. Raises UsageError: its status is not one of `good`, or its time is over."""
        answer = self._carry_out(words, limit)
        _refuse(answer, words[0], good)
        return answer

    def _carry_out(self, words: Sequence[str], limit: float) -> Answer:
        with self._lock:
            return self._commands(words, limit)

    def _cell(self, name: str) -> list[str]:
        return [f"--cell={self.folder.cell(name)}"] if name else []

    def _not_simulated(self, name: str, tree: str) -> str:
        """Return the kind of a cell that is not simulated, as its file states it; `pomona run --simulated` judges it
        with its settings again.
        """
        if name:
            path = self._path(self.folder.cell(name), find_cell)
        else:
            path = usual_cell(read_document(self._path(self.folder.tree(tree), find_tree)))
        kind = _kind(path)
        return "" if kind in SIMULATED else kind or "no cell file"

    def _path(self, word: str, find: Callable[[str], Path]) -> Path:
        return self.folder.root / word if word.startswith("./") else find(word)

    def _sign(self, record: Path, **arguments: Any) -> None:
        """Note in a record that an assistant started its run."""
        text = json_text(
            {"started by": "an assistant (pomona mcp)", "call": call_number.get(), **arguments},
            indent=1,
        )
        (record / STARTED_BY).write_text(text + "\n", encoding="utf-8")


def _cut(text: str) -> str:
    return (
        text
        if len(text) <= MOST_ANSWER
        else f"{text[:MOST_ANSWER]}\n… cut after {MOST_ANSWER} characters"
    )


def _kind(cell: Path) -> str:
    outline = outline_cell(cell, Findings())
    return outline.kind if outline is not None and outline.kind in KINDS else ""


def _meaning(code: str) -> str:
    about = failure_codes().get(code)
    return about.meaning if about is not None else ""


def _set(settings: Mapping[str, str] | None) -> list[str]:
    """Return settings as options. Raises UsageError: a name or a value that none has."""
    found = []
    for key, value in (settings or {}).items():
        if not _KEY.fullmatch(key) or len(value) > MOST_VALUE or not value.isprintable():
            raise UsageError(
                f"the setting '{ascii(key[:60])[1:-1]}' has a name or a value that no setting has"
            )
        found.append(f"--set={key}={value}")
    if len(found) > MOST_SETTINGS:
        raise UsageError(f"more than {MOST_SETTINGS} settings")
    return found


def _summary(answer: Answer, following: str) -> str:
    """Return the last line of a run's output, its summary as JSON, with the next step."""
    found = _last_line(answer)
    if not found:
        raise UsageError(answer.problem or "the run has left no summary")
    return json_text({**found, "next": following}, indent=1)


def _last_line(answer: Answer) -> dict[str, Any]:
    """Return the summary of a run; empty if it has printed none."""
    try:
        found = json.loads(answer.out.strip().splitlines()[-1])
    except (IndexError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _refuse(answer: Answer, command: str, good: tuple[int, ...]) -> None:
    """Raise if a command has not ended well. Raises UsageError: its status is not one of `good`."""
    if answer.status not in good:
        raise UsageError(answer.problem or f"pomona {command} ended with status {answer.status}")
