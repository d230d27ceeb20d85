"""One run at a time on a real cell, and no lock that outlives its process."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from pomona.executive.cell.cell import Cell
from pomona.executive.cell.cell_file import CellFile, read_cell_file
from pomona.executive.cell.connect import connect_cell
from pomona.executive.cell.errors import DeviceError
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell
from pomona.executive.recording.session import RecordingSession
from pomona.executive.running.starting import CellInUseError, alone_on

TREE = "pomona: 1\ntree: t\nroot:\n  wait: 20 ms\n"
CELL = "name: bench\nkind: real\nclock: manual\ndevices: {}\n"
HOLDS = """
import sys, time
from pathlib import Path
from pomona.executive.running.starting import alone_on
with alone_on(Path(sys.argv[1]), "real"):
    print("has it", flush=True)
    time.sleep(60.0)
"""


@pytest.fixture
def order(tmp_path: Path) -> RunOrder:
    tree, cell = tmp_path / "tree.yaml", tmp_path / "cell.yaml"
    tree.write_text(TREE)
    cell.write_text(CELL)
    return RunOrder(tree, cell)


def test_a_second_run_on_a_real_cell_is_refused_until_the_first_is_over(order: RunOrder) -> None:
    linked = order.cell.with_name("linked.yaml")
    linked.symlink_to(order.cell)
    with (
        alone_on(linked, "real"),
        pytest.raises(CellInUseError, match="another run is going on on this cell"),
    ):
        execute(order)
    assert execute(order).result.outcome == "success"
    assert execute(order).result.outcome == "success"


def test_no_other_run_begins_between_the_search_for_a_cut_run_and_the_end_of_the_next_one(
    order: RunOrder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[str] = []

    def try_it(when: str) -> None:
        with pytest.raises(CellInUseError), alone_on(order.cell, "real"):
            pass
        looks.append(when)

    close = RecordingSession.close
    monkeypatch.setattr("pomona.executive.execute.installed_trees", lambda: tmp_path)
    monkeypatch.setattr("pomona.executive.execute.unfinished", lambda *_: try_it("looking"))
    monkeypatch.setattr(
        RecordingSession, "close", lambda session: (close(session), try_it("a run has ended"))[0]
    )
    (tmp_path / "recover.yaml").write_text(TREE.replace("tree: t", "tree: recover"))
    executed = execute(replace(order, record=tmp_path / "runs", recover=True))
    assert executed.result.outcome == "success"
    assert looks == ["looking", "a run has ended", "a run has ended"]


def test_a_copy_of_the_cell_file_leads_to_the_same_devices(tmp_path: Path) -> None:
    def wires(text: str) -> tuple[str, ...]:
        path = tmp_path / "bench.yaml"
        path.write_text(f"kind: real\ndevices:\n  gripper: {{driver: wsg, {text}}}\n")
        return read_cell_file(path).wires()

    here, there = wires("tcp: 192.0.2.7"), wires("tcp: '192.0.2.8:1000'")
    bus = wires("can: {channel: can7}")
    with alone_on(tmp_path / "a.yaml", "real", here):
        again = alone_on(tmp_path / "copy.yaml", "real", wires("tcp: '192.0.2.7:1000'"))
        with (
            pytest.raises(
                CellInUseError, match=r"copy.yaml: another run is going on on 192.0.2.7:1000"
            ),
            again,
        ):
            pass
        with alone_on(tmp_path / "other.yaml", "real", there + bus):
            pass
    with alone_on(tmp_path / "copy.yaml", "real", here):
        pass


def test_a_simulated_cell_has_as_many_runs_as_one_wants(order: RunOrder) -> None:
    with alone_on(order.cell, "simulated"), alone_on(order.cell, "simulated"):
        pass


def test_an_emulated_cell_is_locked_at_the_addresses_outside_its_process(tmp_path: Path) -> None:
    def wires(**options: str) -> tuple[str, ...]:
        return read_cell_file(find_cell("emulated"), options).wires()

    assert wires() == ()
    assert len(wires(time="wall")) == 4
    real = tmp_path / "mixed.yaml"
    real.write_text("kind: emulated\ndevices:\n  gripper: {driver: wsg, tcp: 192.0.2.7}\n")
    there = read_cell_file(real).wires()
    assert there == ("192.0.2.7:1000",)
    with alone_on(real, "emulated", there):
        with (
            pytest.raises(CellInUseError, match=r"192.0.2.7:1000"),
            alone_on(real, "emulated", there),
        ):
            pass
        with (
            alone_on(find_cell("emulated"), "emulated", wires()),
            alone_on(find_cell("emulated"), "emulated", wires()),
        ):
            pass


def test_a_process_that_is_killed_leaves_no_lock(order: RunOrder) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(order.cell)], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "has it\n"
        with pytest.raises(CellInUseError):
            execute(order)
        other.send_signal(signal.SIGKILL)
    assert execute(order).result.outcome == "success"


def test_a_cell_that_is_not_on_the_disk_needs_no_lock(tmp_path: Path) -> None:
    with alone_on(tmp_path / "none.yaml", "real"):
        pass


def test_a_recovery_connects_the_devices_that_the_order_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tree, cell, bare = tmp_path / "tree.yaml", tmp_path / "cell.yaml", tmp_path / "bare.yaml"
    tree.write_text(TREE)
    bare.write_text(CELL)
    hand = "  gripper: {driver: wsg, tcp: '{hand}'}\n"
    cell.write_text(f"name: bench\nkind: real\noptions: {{hand: 192.0.2.7}}\ndevices:\n{hand}")
    (tmp_path / "recover.yaml").write_text(TREE.replace("tree: t", "tree: recover"))
    connected: list[tuple[str, ...]] = []

    def connect_bare(file: CellFile, order: RunOrder) -> Cell:
        connected.append(file.wires())
        return connect_cell(read_cell_file(bare), seed=order.seed)

    monkeypatch.setattr("pomona.executive.execute.installed_trees", lambda: tmp_path)
    monkeypatch.setattr("pomona.executive.execute.connect_cell", connect_bare)
    there = "192.0.2.8:1000"
    executed = execute(RunOrder(tree, cell, settings={"hand": there}, recover=True))
    assert executed.result.outcome == "success"
    assert connected == [(there,), (there,)]


@pytest.mark.parametrize(
    ("settings", "times"), [({}, 0), ({"cleared": True}, 1), ({"recover": True}, 2)]
)
def test_an_operator_who_starts_it_after_a_cut_run_acknowledges_what_the_devices_report(
    order: RunOrder, monkeypatch: pytest.MonkeyPatch, settings: dict[str, bool], times: int
) -> None:
    order.cell.write_text(CELL.replace("clock: manual\n", ""))
    recovery = order.tree.with_name("recover.yaml")
    recovery.write_text(TREE.replace("tree: t", "tree: recover"))
    monkeypatch.setattr("pomona.executive.execute.installed_trees", lambda: recovery.parent)
    told: list[str] = []
    monkeypatch.setattr(Cell, "acknowledge", lambda cell: told.append(cell.name))
    assert execute(replace(order, **settings)).result.outcome == "success"
    assert told == ["bench"] * times


def test_a_device_that_refuses_the_acknowledgement_ends_the_start(
    order: RunOrder, monkeypatch: pytest.MonkeyPatch
) -> None:
    order.cell.write_text(CELL.replace("clock: manual\n", ""))

    def refuse(_cell: Cell) -> None:
        raise DeviceError("gripper", "is in fast stop")

    monkeypatch.setattr(Cell, "acknowledge", refuse)
    with pytest.raises(UsageError, match="is in fast stop; nothing has moved"):
        execute(replace(order, cleared=True))
