"""Unusable input gives one clear message, exit status 2, no traceback, and no motion."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from pomona.executive.cell import connect as connecting
from pomona.executive.cell.device import ConnectContext, Device
from pomona.executive.cell.registration import Settings
from pomona.executive.cli import main
from pomona.executive.recording.scan import examine
from pomona.executive.running.runner import Runner
from pomona.executive.values.processes import WORDS


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    status = main([*arguments, "--no-record"])
    captured = capsys.readouterr()
    assert status == 2
    assert "Traceback" not in captured.err + captured.out
    return captured.err


def test_a_missing_tree_is_named_with_the_existing_ones(capsys: pytest.CaptureFixture[str]) -> None:
    error = refused(capsys, "run", "pick_aple")
    assert "no tree file 'pick_aple'" in error
    assert "did you mean 'pick_apple'?" in error


def test_a_missing_cell_is_named_with_the_existing_ones(capsys: pytest.CaptureFixture[str]) -> None:
    error = refused(capsys, "run", "pick_apple", "--cell", "nowhere.yaml")
    assert "no cell file 'nowhere.yaml'" in error
    assert "sim" in error


@pytest.mark.slow
@pytest.mark.parametrize(("closed", "encoding"), [(True, "utf-8"), (False, "ascii:strict")])
def test_a_run_ends_well_with_closed_streams_or_an_encoding_without_our_signs(
    closed: bool, encoding: str, tmp_path: Path
) -> None:
    tree, cell = tmp_path / "t.yaml", tmp_path / "cell.yaml"
    tree.write_text("pomona: 1\ntree: t\nroot: {wait: 100 ms}\n")
    cell.write_text("name: bench\nkind: mock\nclock: manual\ndevices: {}\n")
    program = "import sys; from pomona.executive.cli import main; sys.exit(main())"
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            program,
            "run",
            str(tree),
            "--cell",
            str(cell),
            "--record",
            str(tmp_path / "runs"),
        ],
        stdout=None if closed else subprocess.PIPE,
        env={**os.environ, "PYTHONIOENCODING": encoding},
        preexec_fn=(lambda: os.closerange(0, 3)) if closed else None,
    )
    assert done.returncode == 0
    (record,) = (tmp_path / "runs").iterdir()
    assert examine(record / "run.mcap").state == "whole"
    assert closed or b"\\u2713 t" in done.stdout


@pytest.mark.parametrize(
    "words",
    [
        ("new", "package", "my_kit", "--into", "file"),
        ("new", "fruit", "plum", "--into", "file"),
        ("show", "pick_apple", "--svg", "file/tree.svg"),
    ],
    ids=["package", "fruit", "picture"],
)
def test_a_place_that_cannot_be_written_is_named_in_one_line(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("file/")
    what, _, advice = line.partition(";")
    assert what.endswith(": Not a directory")
    assert ("`--into DIR`" in advice) == ("--into" in words)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "error["),
        ("root: [", ":1:"),
        (
            "pomona: 1\ntree: t\nroot:\n  sequence:\n    - Refien: {}\n",
            ":5:7: error[unknown-skill]: no skill named 'Refien'",
        ),
        ("pomona: 1\ntree: t\nroot:\n  sequence:\n    - Lift: {height: 5}\n", "lacks a unit"),
        ("\x00\x01", ":1:1: error[yaml]: not YAML: unacceptable character #x0000"),
        (
            "pomona: 1\ntree: bäum\x00\n",
            ":2:11: error[yaml]: not YAML: unacceptable character #x0000",
        ),
    ],
)
def test_a_broken_tree_names_place_and_mistake(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str, expected: str
) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    error = refused(capsys, "run", str(path))
    assert expected in error
    assert "Nothing was run." in error


def test_a_file_that_is_no_text_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "picture.yaml"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    assert "not a text file" in refused(capsys, "run", str(path))


@pytest.mark.parametrize(
    "setting",
    ["attempts", "=3", "attempts=many", "attempts=0", "radius=120", "radius=12 kg", "atempts=3"],
)
def test_a_bad_setting_is_refused_before_anything_moves(
    capsys: pytest.CaptureFixture[str], setting: str
) -> None:
    error = refused(capsys, "run", "pick_apple", "--set", setting)
    assert setting.split("=")[0] in error


def test_a_broken_cell_names_the_place(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text("name: x\nkind: simulated\ndevices:\n  arm: {driver: no-such-driver}\n")
    error = refused(capsys, "run", "pick_apple", "--cell", str(path))
    assert "cell.yaml:4:" in error
    assert "no-such-driver" in error


def test_a_cell_without_the_devices_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text("name: x\nkind: mock\nclock: manual\ndevices: {}\n")
    error = refused(capsys, "run", "pick_apple", "--cell", str(path))
    assert "Camera" in error


def test_a_breakpoint_without_anyone_to_pass_it_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert "add --dashboard" in refused(
        capsys, "run", "pick_apple", "--dry", "--break-after", "Refine"
    )


def test_a_file_that_cannot_be_written_is_named(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "no folder" / "tree.svg"
    assert main(["show", "pick_apple", "--svg", str(out)]) == 2
    assert capsys.readouterr().err.replace("\n", "") == f"{out}: No such file or directory"


@pytest.mark.parametrize(
    "words",
    [("export", "t.yaml", "--out"), ("show", "t.yaml", "--svg"), ("import", "t.xml", "--out")],
)
def test_a_tree_file_is_never_overwritten(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    text = "pomona: 1\ntree: t\nroot: {wait: 1 s}\n"
    Path("t.yaml").write_text(text)
    assert main(["export", "t.yaml", "--out", "t.xml"]) == 0
    assert main([*words, "t.yaml"]) == 2
    assert "t.yaml exists, and nothing is overwritten" in capsys.readouterr().err
    assert Path("t.yaml").read_text() == text


def test_a_file_that_the_command_wrote_is_written_again(tmp_path: Path) -> None:
    for words in (
        ("export", "pick_apple", "--out", "t.xml"),
        ("show", "pick_apple", "--svg", "t.svg"),
    ):
        for _ in range(2):
            assert main([*words[:-1], str(tmp_path / words[-1])]) == 0


def test_export_and_import_give_a_tree_file_again(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    tree, xml, again = (tmp_path / name for name in ("a.yaml", "a.xml", "b.yaml"))
    tree.write_text("pomona: 1\ntree: t\nroot:\n  sequence:\n    - wait: 1 s\n      timeout: 2 s\n")
    assert main(["export", str(tree), "--out", str(xml)]) == 0
    assert main(["import", str(xml), "--out", str(again)]) == 0
    assert yaml.safe_load(again.read_text()) == yaml.safe_load(tree.read_text())
    assert main(["check", "--cell", "sim", str(again)]) == 0
    assert "nothing is wrong" in capsys.readouterr().out


def test_a_note_of_a_cell_is_given_once_for_all_trees_that_name_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["check", "pick_apple", "pick_and_place", "--cell", "sim"]) == 0
    assert capsys.readouterr().out.count("note[unseen]") == 1


def test_skills_are_listed_with_ports_units_and_codes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["skills"]) == 0
    listed = " ".join(capsys.readouterr().out.split())
    assert "inlier_band: length = 4 mm" in listed
    assert "TOO_FEW_INLIERS" in listed


SMALL_COMMANDS = """
import sys
from pomona.executive.cli import main
from pomona.executive.commands.command_line import make_parser
from pomona.executive.running.runner import Runner

assert "sizes and positions of the fruit" in make_parser([]).format_help()
assert "pomona.skills" not in sys.modules, "--help imports the skills"

def loaded(arguments, *heavy):
    assert main(arguments) in (0, 2), arguments
    for name in heavy:
        assert name not in sys.modules, f"{arguments[0]} imports {name}"

compiled = ("torch", "numba", "mujoco", "matplotlib", "scipy", "trimesh", "cv2", "ompl")
loaded(["show", "pick_apple"], *compiled, "numpy", "rich", "pomona.executive.execute")
running = "pomona.executive.execute", "pomona.executive.recording.recorder"
loaded(["runs", "list", "--record", "nowhere"], *compiled, "numpy", *running)
slow = [name for name in compiled if name != "mujoco"]  # it judges the robot's file
loaded(["check", "pick_apple"], *slow, "pomona.applications.conveyor", "pomona.executive.execute")
"""


@pytest.mark.slow
def test_small_commands_load_only_needed_modules() -> None:
    command = [sys.executable, "-c", SMALL_COMMANDS]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_declarations_of_skills_are_read_without_loading_their_networks() -> None:
    script = "import sys; from pomona.executive.registry import Registry; assert len(Registry.installed()) > 10"
    heavy = "; print([name for name in ('torch', 'trimesh', 'matplotlib', 'scipy.stats') if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", script + heavy], capture_output=True, text=True, timeout=60
    )
    assert done.stdout.splitlines()[-1] == "[]", done.stderr


FAILING = "pomona: 1\ntree: t\nroot: {fail: {code: NO_LUCK, message: the dice fell badly}}\n"


@pytest.mark.parametrize("quiet", [True, False])
def test_a_quiet_run_that_fails_gives_the_reason_in_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, quiet: bool
) -> None:
    tree = tmp_path / "t.yaml"
    tree.write_text(FAILING)
    assert main(["run", str(tree), "--dry", "--no-record", *(["--quiet"] if quiet else [])]) == 1
    said = capsys.readouterr()
    if quiet:
        assert said.out == ""
        (line,) = said.err.splitlines()
        assert "NO_LUCK" in line
        assert "the dice fell badly" in line
    else:
        assert said.err == ""


def test_a_quiet_run_that_ends_in_the_safe_state_gives_the_reason(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_runner: Runner) -> None:
        raise RuntimeError("the wheel came off")

    monkeypatch.setattr(Runner, "_tick", broken)
    tree = tmp_path / "t.yaml"
    tree.write_text(FAILING)
    assert main(["run", str(tree), "--dry", "--no-record", "--quiet"]) == 3
    said = capsys.readouterr()
    assert said.out == ""
    assert "RuntimeError" in said.err
    assert "the wheel came off" in said.err


@pytest.mark.slow
def test_a_reader_that_is_gone_ends_a_run_in_the_safe_state(tmp_path: Path) -> None:
    tree = tmp_path / "t.yaml"
    tree.write_text(
        "pomona: 1\ntree: t\nroot: {repeat: 500, sequence: [{wait: 20 ms}, {succeed: {}}]}\n"
    )
    command = [
        sys.executable,
        "-m",
        "pomona.executive.cli",
        "run",
        str(tree),
        "--dry",
        "--pace",
        "real",
    ]
    with subprocess.Popen(
        [*command, "--record", str(tmp_path / "runs")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        said = process.stderr.read()
        assert process.wait(60) == 3
    assert "Traceback" not in said
    assert main(["explain", "--record", str(tmp_path / "runs")]) == 0


def test_a_signal_that_a_compiled_module_turned_into_an_error_gives_no_traceback(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_words: object) -> int:
        raise ImportError("initialization failed") from KeyboardInterrupt()

    monkeypatch.setattr("pomona.executive.cli._run", interrupted)
    assert main(["skills"]) == 130
    assert capsys.readouterr().err == "interrupted from the keyboard\n"


MOCK_CELL = """name: bench
kind: mock
clock: manual
world: {driver: mock}
devices:
  arm: {driver: mock-arm}
  gripper: {driver: mock-gripper}
"""


@pytest.mark.parametrize("number", list(WORDS))
@pytest.mark.parametrize("stage", ["connecting the cell", "preparing Turn"])
def test_a_signal_before_the_run_is_one_line_with_the_stage_and_closes_the_devices(
    stage: str,
    number: int,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tree, cell, records = tmp_path / "t.yaml", tmp_path / "cell.yaml", tmp_path / "runs"
    tree.write_text("pomona: 1\ntree: t\nroot: {wait: 100 ms}\n")
    cell.write_text(MOCK_CELL)
    closed: list[str] = []
    connect = connecting._connect

    def connect_one(settings: Settings[Any], context: ConnectContext) -> Device:
        if stage == "connecting the cell" and settings.name == "gripper":
            signal.raise_signal(number)
        device = connect(settings, context)
        monkeypatch.setattr(device, "close", lambda: closed.append(device.name))
        return device

    def prepare(_runner: Runner, tell: Callable[[str, int, int], None]) -> None:
        tell("Turn", 0, 2)
        signal.raise_signal(number)

    monkeypatch.setattr(connecting, "_connect", connect_one)
    monkeypatch.setattr(Runner, "prepare", prepare)
    status = main(["run", str(tree), "--cell", str(cell), "--record", str(records)])
    reason = WORDS[signal.Signals(number)]
    said = f"{reason}. The run had not begun ({stage}): no skill of it moved anything.\n"
    assert (status, capsys.readouterr().err) == (128 + number, said)
    assert closed == (
        ["arm", "world"] if stage == "connecting the cell" else ["gripper", "arm", "world"]
    )
    assert not list(records.glob("*"))


INTERRUPTED_IMPORT = """
import sys

class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == "pomona.executive.commands.command_line":
            raise {how}

sys.meta_path.insert(0, Interrupts())
import pomona.executive.cli
"""


@pytest.mark.parametrize(
    "how", ["KeyboardInterrupt", "ImportError('failed') from KeyboardInterrupt()"]
)
def test_ctrl_c_while_the_program_is_loaded_is_one_line_and_status_130(how: str) -> None:
    program = INTERRUPTED_IMPORT.replace("{how}", how)
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60
    )
    assert (ended.returncode, ended.stderr) == (130, "interrupted from the keyboard\n")


def test_ctrl_c_before_signals_are_handled_is_one_line_and_status_130() -> None:
    program = """
import sys
from pomona.executive import cli

def interrupted():
    raise KeyboardInterrupt

cli.unwaiting_output, sys.argv = interrupted, ["pomona", "run", "x"]
sys.exit(cli.main())
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60
    )
    assert (ended.returncode, ended.stderr) == (130, "interrupted from the keyboard\n")


def test_a_module_that_cannot_be_loaded_is_not_reported_as_an_interruption() -> None:
    program = INTERRUPTED_IMPORT.replace("{how}", "ImportError('broken')")
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60
    )
    assert ended.returncode == 1
    assert "ImportError: broken" in ended.stderr


LEAVES_BEHIND = """
import multiprocessing, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from pomona.executive import cli
from pomona.executive.running.compute import Computations

def leave(_words):
    if what == "thread":
        threading.Thread(target=time.sleep, args=(1e6,), name="a skill's").start()
    if what == "process":
        multiprocessing.get_context("fork").Process(target=time.sleep, args=(1e6,), name="a skill's").start()
    if what == "computation":
        Computations().submit("a", time.sleep, (1e6,), False)
    if what == "pool":
        ThreadPoolExecutor().submit(int).result()
    return int(status)

status, what, cli._run = sys.argv.pop(), sys.argv.pop(), leave
sys.exit(cli.main())
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "name"),
    [("thread", "a skill's"), ("process", "a skill's"), ("computation", "pomona-compute_0")],
)
def test_a_leftover_of_a_skill_is_named_and_does_not_keep_the_process(what: str, name: str) -> None:
    command = [sys.executable, "-c", LEAVES_BEHIND, what, "3"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 3
    assert done.stderr == f"still running after the end, and ended with the process: {name}\n"


@pytest.mark.slow
@pytest.mark.parametrize(("what", "said"), [("computation", False), ("thread", True)])
def test_after_ctrl_c_a_computation_that_was_abandoned_needs_no_word(what: str, said: bool) -> None:
    command = [sys.executable, "-c", LEAVES_BEHIND, what, "130"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 130
    assert done.stderr == (
        "still running after the end, and ended with the process: a skill's\n" if said else ""
    )


def test_a_pool_that_waits_for_work_ends_by_itself_and_is_not_named() -> None:
    command = [sys.executable, "-c", LEAVES_BEHIND, "pool", "3"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (3, "")


@pytest.mark.slow
def test_figures_are_drawn_where_a_notebook_names_a_backend_that_is_not_here() -> None:
    script = (
        "from pomona.executive.cli import main\nmain(['completion', 'bash'])\nimport matplotlib\n"
    )
    environment = os.environ | {"MPLBACKEND": "module://matplotlib_inline.backend_inline"}
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("folder", ["", " "])
def test_a_folder_of_records_has_a_name(folder: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["runs", "list", "--record", folder])
    assert ended.value.code == 2
    assert "the name of the folder is empty" in capsys.readouterr().err


def test_an_unknown_option_shows_the_commands_own_usage(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["fmt", "--diff", "tree.yaml"])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith("usage: pomona fmt ")
    assert "unrecognized arguments: --diff" in told


def test_a_misspelt_skill_is_answered_with_the_one_that_is_meant(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["skills", "Refin"]) == 2
    assert "no skill 'Refin'; did you mean 'Refine'?" in capsys.readouterr().err
    assert main(["skills", "Lift"]) == 0
    assert "the fruit's weight alone needs more force" in " ".join(capsys.readouterr().out.split())


def test_an_import_ends_with_the_check_which_names_the_skills_that_are_not_installed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    xml, tree = tmp_path / "nav.xml", tmp_path / "nav.yaml"
    nodes = "<Sequence><ComputePath/><FollowPath/></Sequence>"
    xml.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="nav">{nodes}</BehaviorTree></root>')
    assert main(["import", str(xml), "--out", str(tree)]) == 0
    assert f"pomona check {tree}" in capsys.readouterr().err
    assert main(["check", str(tree)]) == 2
    told = capsys.readouterr().out
    assert "no skill named 'ComputePath'" in told
    assert "no skill named 'FollowPath'" in told


def test_a_foreign_tree_with_stubs_is_checked_run_dry_and_exported_and_not_run(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    xml, tree = tmp_path / "nav.xml", tmp_path / "nav.yaml"
    nodes = '<Sequence><ComputePath goal="{goal}" path="{path}" planner="Grid"/><FollowPath path="{path}"/></Sequence>'
    xml.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="nav">{nodes}</BehaviorTree></root>')
    assert main(["import", str(xml), "--stubs", "--out", str(tree)]) == 0
    assert yaml.safe_load(tree.read_text())["skills"] == {
        "ComputePath": {"out": ["goal", "path"], "in": ["planner"]},
        "FollowPath": {"in": ["path"]},
    }
    assert main(["check", "--cell", "sim", str(tree)]) == 0
    assert main(["show", str(tree)]) == 0
    assert main(["run", str(tree), "--dry", "--no-record", "--quiet"]) == 0
    assert main(["export", str(tree)]) == 0
    assert '<FollowPath path="{path}"' in capsys.readouterr().out
    assert main(["run", str(tree), "--no-record"]) == 2
    assert "declared in the tree and not installed" in " ".join(capsys.readouterr().err.split())


def test_an_import_names_every_part_without_translation_and_writes_nothing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    xml, tree = tmp_path / "nav.xml", tmp_path / "nav.yaml"
    nodes = '<Sequence><SpeedController min_rate="0.1"><Route/></SpeedController>\n<Walk/><Inverter/></Sequence>'
    xml.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="nav">{nodes}</BehaviorTree></root>')
    assert main(["import", str(xml), "--stubs", "--out", str(tree)]) == 1
    told = capsys.readouterr().err
    assert "nav.xml:1:" in told
    assert "<SpeedController> has no counterpart" in told
    assert "nav.xml:2:" in told
    assert "<Inverter> has 0 children instead of 1" in told
    assert not tree.exists()


def test_a_declared_skill_has_the_ports_of_its_declaration(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    tree = tmp_path / "t.yaml"
    head = "pomona: 1\ntree: t\nskills:\n  Walk: {in: [goal]}\n"
    tree.write_text(f"{head}root:\n  Walk: {{gaol: here}}\n")
    assert main(["check", str(tree)]) == 2
    assert "Walk has no port 'gaol'; did you mean 'goal'?" in capsys.readouterr().out
    tree.write_text(head.replace("[goal]", "goal") + "root:\n  Walk: {}\n")
    assert main(["check", str(tree)]) == 2
    assert "a list of names; write in: [goal]" in capsys.readouterr().out
