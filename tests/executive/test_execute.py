"""Orders: settings before a run begins."""

from __future__ import annotations

import io
import logging
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from pomona.executive import execute as module
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.recording.folder import RecordError, refuse_unwritable
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import Event, OperatorActed, StateChanged
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import Starting
from pomona.executive.running.tick import Side


def order(*breaks: tuple[str, Side]) -> RunOrder:
    return RunOrder(find_tree("pick_apple"), find_cell("sim"), dry=True, breaks=breaks)


def test_a_breakpoint_at_no_node_is_refused_with_similar_names() -> None:
    with pytest.raises(UsageError, match="no node 'Refin' to break at: did you mean 'Refine'"):
        execute(order(("Refin", "after")))


@pytest.mark.parametrize(("setting", "kind"), [({}, "emulated"), ({"sort": "real"}, "real")])
def test_an_order_for_a_simulated_cell_refuses_another_kind_also_one_that_a_setting_gives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, setting: dict[str, str], kind: str
) -> None:
    (tmp_path / "pause.yaml").write_text("pomona: 1\ntree: pause\nroot:\n  wait: 1 s\n")
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        'kind: "{sort}"\noptions: {sort: emulated}\nworld: {driver: mock}\ndevices: {arm: {driver: mock-arm}}\n'
    )
    connected: list[object] = []
    monkeypatch.setattr(module, "connect_cell", lambda file, *_: connected.append(file))
    with pytest.raises(
        UsageError, match=rf"cell.yaml: not a simulated cell but of kind {kind}. Nothing was run."
    ):
        execute(RunOrder(tmp_path / "pause.yaml", cell, settings=setting, simulated=True))
    assert not connected


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_a_seed_that_no_record_holds_is_refused(seed: int) -> None:
    with pytest.raises(UsageError, match=f"the seed {seed} is not from 0 to 9223372036854775807"):
        RunOrder(find_tree("pick_apple"), find_cell("sim"), seed)


def test_breakpoints_of_an_order_hold_the_run_from_its_start() -> None:
    runners: list[Runner] = []
    held: list[str] = []

    def resume_when_paused(event: Event) -> None:
        if isinstance(event, StateChanged) and event.state == "pausing":
            held.append(event.because)
        if isinstance(event, StateChanged) and event.state == "paused":
            runners[0].resume(event.pause, "ada")

    executed = execute(
        order(("Refine", "before"), ("Refine", "after")),
        [resume_when_paused],
        on_ready=runners.append,
    )
    assert executed.result.outcome == "success"
    assert [because.split()[1] for because in held] == ["before", "after"]
    assert all(because.endswith("Refine") for because in held)


def test_a_paused_run_reloads_its_file_from_the_disk_unless_its_text_was_given(
    tmp_path: Path,
) -> None:
    tree = tmp_path / "look.yaml"
    nodes = "    - MoveTo: {pose: home}\n    - MoveTo: {pose: observe}\n      name: Look\n"
    text = f"pomona: 1\ntree: look\nroot:\n  sequence:\n{nodes}"
    for texts, outcome in (({}, ["reload"]), ({str(tree): text}, ["no tree file"])):
        tree.write_text(text)
        runners: list[Runner] = []
        said: list[str] = []

        def reload_when_paused(
            event: Event, runners: list[Runner] = runners, said: list[str] = said
        ) -> None:
            if isinstance(event, OperatorActed) and event.action == "reload":
                said.append(event.action)
            if isinstance(event, StateChanged) and event.state == "paused":
                tree.write_text(text.replace("pose: observe", "pose: home"))
                try:
                    runners[0].reload(event.pause, "ada")
                except UsageError as error:
                    said.append(str(error))
                except PomonaError as error:
                    said.append(str(error)[-12:])
                runners[0].resume(event.pause, "ada")

        breaks: tuple[tuple[str, Side], ...] = (("look/MoveTo", "after"),)
        run = RunOrder(tree, find_cell("sim"), dry=True, texts=texts, breaks=breaks)
        assert (
            execute(run, [reload_when_paused], on_ready=runners.append).result.outcome == "success"
        )
        assert said == outcome


def test_a_folder_that_takes_no_record_is_refused_before_the_cell_is_connected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "runs").write_text("a file")
    connected: list[object] = []
    monkeypatch.setattr(module, "connect_cell", lambda file, *_: connected.append(file))
    with pytest.raises(
        RecordError, match=r"runs: no record can be written there: .*`--record DIR` names another"
    ):
        execute(RunOrder(find_tree("pick_apple"), find_cell("sim"), record=tmp_path / "runs"))
    assert not connected


def test_a_full_disk_is_found_before_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full(io.RawIOBase):
        def write(self, _content: object) -> int:
            return 100  # as a write call does that meets the end of the room

    monkeypatch.setattr(tempfile, "TemporaryFile", lambda **_how: Full())
    with pytest.raises(RecordError, match="No space left on device"):
        refuse_unwritable(tmp_path)


def test_the_test_of_a_folder_of_records_makes_nothing(tmp_path: Path) -> None:
    refuse_unwritable(tmp_path / "runs" / "today")
    assert list(tmp_path.iterdir()) == []


def test_a_warning_of_the_preparation_stands_in_its_line_on_terminal_and_page(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def prepare(_runner: Runner, tell: Callable[[str, int, int], None]) -> None:
        tell("MoveTo", 0, 2)
        logging.getLogger("pomona").warning("compiling the motion kernels, once, about %d s", 30)
        tell("Plan", 1, 2)

    stages: list[str] = []
    monkeypatch.setattr(Runner, "prepare", prepare)
    starting = Starting(
        lambda: stages.append(starting.stage.what if starting.stage is not None else "")
    )
    execute(RunOrder(find_tree("pick_apple"), find_cell("sim"), dry=True), starting=starting)
    note = ": compiling the motion kernels, once, about 30 s"
    assert stages[-4:] == [
        "preparing MoveTo",
        f"preparing MoveTo{note}",
        f"preparing Plan{note}",
        "",
    ]
    handlers = logging.getLogger("pomona").handlers
    assert not [handler for handler in handlers if isinstance(handler, module._Notes)]


def test_a_reader_who_leaves_during_the_preparation_ends_it_as_a_reader_who_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def prepare(_runner: Runner, _tell: Callable[[str, int, int], None]) -> None:
        raise BrokenPipeError

    monkeypatch.setattr(Runner, "prepare", prepare)
    with pytest.raises(BrokenPipeError):
        execute(RunOrder(find_tree("pick_apple"), find_cell("sim"), dry=True))


def test_a_stop_during_the_preparation_is_a_recorded_run_without_a_tick(tmp_path: Path) -> None:
    def stop_when_preparing() -> None:
        if starting.stage is not None and starting.stage.done == 1 and not starting.cancelled:
            starting.cancel("safe stop by ada", "ada")

    starting = Starting(stop_when_preparing)
    executed = execute(
        RunOrder(find_tree("pick_apple"), find_cell("sim"), dry=True, record=tmp_path),
        starting=starting,
    )
    assert (executed.result.outcome, executed.result.ticks) == ("stopped", 0)
    assert executed.record is not None
    acts = [(e.who, e.action) for e in read_events(executed.record) if isinstance(e, OperatorActed)]
    assert acts == [("ada", "safe_stop")]
