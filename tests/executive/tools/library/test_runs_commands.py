"""`pomona runs`, `rerun` and `explain` as a person uses them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from recorded_events import FAILED, SUCCEEDED, write

from pomona.executive.cli import main
from pomona.executive.recording import recorder as recorder_module
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.recorder import Recorder
from pomona.executive.run_views import RunView, RunViews

TREE = """\
pomona: 1
tree: try_thrice
parameters:
  pauses: {type: int, default: 3}
subtrees:
  look: {file: parts/look.yaml}
root:
  sequence:
    - look: {}
    - sequence:
        - wait: 1 s
        - MoveTo: {pose: home}
      name: Attempt
      retry: "{pauses}"
"""
LOOK = "pomona: 1\ntree: look\nroot:\n  wait: 500 ms\n"
MOCKS = "mocks:\n  MoveTo: [NO_PATH, NO_PATH, success]\n"
ALWAYS = "mocks:\n  MoveTo: [NO_PATH]\n"


@pytest.fixture(autouse=True)
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands look for records in runs/ here."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "look.yaml").write_text(LOOK)
    (tmp_path / "tree.yaml").write_text(TREE)
    (tmp_path / "mocks.yaml").write_text(MOCKS)
    (tmp_path / "always.yaml").write_text(ALWAYS)


def say(capsys: pytest.CaptureFixture[str], *arguments: str, status: int = 0) -> str:
    """Return the output of a command, without its line breaks."""
    capsys.readouterr()
    assert main(list(arguments)) == status
    captured = capsys.readouterr()
    assert "Traceback" not in captured.out + captured.err
    return " ".join((captured.out + captured.err).split())


def run(mocks: str = "mocks.yaml", *more: str, status: int = 0) -> None:
    assert main(["run", "tree.yaml", "--dry", mocks, "--quiet", *more]) == status


def test_one_run_is_counted_in_the_singular(capsys: pytest.CaptureFixture[str]) -> None:
    write(Path("runs/2026-01-02_good"), SUCCEEDED)
    assert "1 run, " in say(capsys, "runs", "list")


def test_list_shows_how_each_run_ended(capsys: pytest.CaptureFixture[str]) -> None:
    write(Path("runs/2026-01-01_failed"), FAILED)
    write(Path("runs/2026-01-02_good"), SUCCEEDED)
    Path("runs/2026-01-03_now").mkdir()
    recorder = Recorder(Path("runs/2026-01-03_now"))
    said = say(capsys, "runs", "list")
    for column in ("run", "cell", "took", "why"):
        assert column in said.split(), column
    recorder.close()
    assert "NO_PATH: there is no path" in said
    assert "▶ 2026-01-03_now" in said
    assert "3 runs" in said
    assert "1 running, 1 success, 1 failure" in said
    assert "2026-01-02_good" not in say(capsys, "runs", "list", "--failed")
    assert "1 of 3 runs" in say(capsys, "runs", "list", "apple_5", "no_path")
    rows = [json.loads(line) for line in _lines(capsys, "runs", "list", "--json", "--limit", "2")]
    assert [row["run"] for row in rows] == ["2026-01-03_now", "2026-01-02_good"]


def _lines(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    capsys.readouterr()
    assert main(list(arguments)) == 0
    return capsys.readouterr().out.splitlines()


def test_show_prints_everything_about_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    run("mocks.yaml", "--set", "pauses=4", "--seed", "5")
    said = say(capsys, "runs", "show", "last")
    for words in ("try_thrice", "seed 5", "pauses=4", "NO_PATH × 2", "py-trees", "/events", "/log"):
        assert words in said
    assert json.loads(_lines(capsys, "runs", "show", "last", "--json")[0])["codes"] == {
        "NO_PATH": 2
    }


def test_compare_puts_runs_side_by_side_and_finds_where_two_of_a_kind_part(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run()
    run("always.yaml", status=1)
    first, second = sorted(path.name for path in Path("runs").iterdir() if path.is_dir())
    said = say(capsys, "runs", "compare", first, second)
    assert "outcome success failure" in said
    assert "× NO_PATH 2 3" in said
    assert "they part" not in said  # other mocks: nobody expects the same
    shutil.copytree(Path("runs") / first, "runs/again")
    assert "consist of the same" in say(capsys, "runs", "compare", first, "again")


def test_explain_gives_events_and_causes(capsys: pytest.CaptureFixture[str]) -> None:
    run("always.yaml", "--set", "pauses=2", status=1)
    said = say(capsys, "explain")
    assert "try_thrice ran without a cell, with seed 0 and pauses = 2" in said
    assert "It failed after" in said
    assert "The reason, at 2.5 s: MoveTo (line 12 of the tree) failed with NO_PATH" in said
    assert "Remedy: raise `budget`" in said
    assert "attempt 1 of 2" not in said
    said = say(capsys, "explain", "last", "--all")
    assert "At 1.5 s attempt 1 of 2 (Attempt) ended with NO_PATH, too." in said
    assert "On the way failed: MoveTo NO_PATH 2 times." in said


def test_explain_names_the_attempt_that_succeeded(capsys: pytest.CaptureFixture[str]) -> None:
    run()
    assert "It succeeded after 3.5 s, on the third attempt of 3." in say(capsys, "explain", "last")


def test_explain_reports_where_and_why_a_record_was_cut_off(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "CHUNK_BYTES", 1000)
    run()
    (path,) = Path("runs").glob(f"*/{EVENTS_FILE}")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 4 // 10])
    said = say(capsys, "explain", "last")
    assert "The record ends after" in said
    assert "the file was cut afterwards" in said
    advice = "`pomona runs repair` completes the files of 1"
    assert advice in say(capsys, "runs", "list")
    assert "✓" in say(capsys, "runs", "repair")
    assert "no record needs a repair" in say(capsys, "runs", "repair")
    said = say(capsys, "runs", "list")
    assert "cut off" in said
    assert advice not in said


def test_rerun_repeats_a_run_from_its_record_alone(capsys: pytest.CaptureFixture[str]) -> None:
    run("mocks.yaml", "--set", "pauses=4", "--seed", "7")
    for path in (Path("tree.yaml"), Path("parts/look.yaml"), Path("mocks.yaml")):
        path.unlink()
    assert "✓ the same" in say(capsys, "rerun", "last")
    assert len(list(Path("runs").glob("*/"))) == 1  # it leaves no record of its own


def test_rerun_shows_the_first_difference(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    encoded = recorder_module.encoded
    with monkeypatch.context() as then:
        then.setattr(
            recorder_module,
            "encoded",
            lambda message: encoded(message).replace(b"0.5 s left", b"0.6 s left"),
        )
        run()
    said = say(capsys, "rerun", "last", status=1)
    assert "they part at event" in said
    assert (
        'NodeChanged try_thrice/look/wait, feedback recorded "0.6 s left" now "0.5 s left"' in said
    )


def test_rerun_refuses_a_run_of_a_real_cell(capsys: pytest.CaptureFixture[str]) -> None:
    from recorded_events import started

    write(Path("runs/real"), (started(cell_kind="real"),))
    assert "only a simulated run can be repeated" in say(capsys, "rerun", "real", status=2)


def test_rerun_connects_no_real_device_of_a_record_that_claims_to_be_simulated(
    capsys: pytest.CaptureFixture[str],
) -> None:
    from recorded_events import started

    tree = "pomona: 1\ntree: t\nroot: {wait: 20 ms}\n"
    for number, (kind, device) in enumerate(
        [("real", ""), ("simulated", "g: {driver: wsg, tcp: 127.0.0.1}")]
    ):
        cell = f"name: b\nkind: {kind}\ndevices: {{{device}}}\n"
        about = {"cell": "b", "cell_kind": "simulated", "cell_path": str(Path("b.yaml").resolve())}
        write(
            Path(f"runs/r{number}"),
            (started(**about, cell_text=cell, tree_text=tree, cell_files={}, settings={}),),
        )
    assert "the cell in the record is of kind real" in say(capsys, "rerun", "r0", status=2)
    assert "it moves a device outside this process" in say(capsys, "rerun", "r1", status=2)


def test_frames_and_export_name_the_written_files(capsys: pytest.CaptureFixture[str]) -> None:
    write(Path("runs/one"), SUCCEEDED)
    assert "one.zip" in say(capsys, "runs", "export", "one")
    assert "one.jsonl" in say(capsys, "runs", "export", "one", "one.jsonl")
    assert "exists, and nothing" in say(capsys, "runs", "export", "one", status=2)
    assert "one_frames" in say(capsys, "runs", "export", "one", "--to", "frames")
    assert "one.html" in say(capsys, "runs", "export", "one", "one.html")
    refused = say(capsys, "runs", "export", "one", "one.csv", status=2)
    assert "the suffix selects the format" in refused
    assert ".mcap" in refused
    assert "frames" in refused
    assert "--to selects the format" in say(
        capsys, "runs", "export", "one", "--to", "paper", status=2
    )


def test_prune_lists_asks_and_spares(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("a", "b", "c"):
        write(Path("runs") / name, SUCCEEDED)
    assert "no limit is given" in say(capsys, "runs", "prune", status=2)
    assert "2 of 3 records" in say(capsys, "runs", "prune", "--keep", "1", "--dry")
    assert "no terminal to ask on" in say(capsys, "runs", "prune", "--keep", "1", status=2)
    assert len(list(Path("runs").glob("*/"))) == 3
    assert "removed 2 records" in say(capsys, "runs", "prune", "--keep", "1", "--yes")
    assert [path.name for path in Path("runs").glob("*/")] == ["c"]
    assert "no record to remove" in say(capsys, "runs", "prune", "--keep", "1", "--yes")


def test_prune_removes_what_a_view_of_the_run_left_there(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Noting(RunView):
        files = ("note.json",)

    views = [Noting(), RunView()]
    monkeypatch.setattr(RunViews, "installed", lambda: views)
    for name in ("a", "b"):
        write(Path("runs") / name, SUCCEEDED)
    Path("runs/a/note.json").write_text("{}")
    assert "removed 1 records" in say(capsys, "runs", "prune", "--keep", "1", "--yes")
    assert not Path("runs/a").exists()


def test_prune_removes_what_runs_wrote_and_leaves_a_persons_files(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("a", "b", "c"):
        write(Path("runs") / name, SUCCEEDED)
    Path("runs/a/chapter.tex").write_text("my notes")
    Path("runs/a/frames").mkdir()
    said = say(capsys, "runs", "prune", "--keep", "1", "--yes")
    assert "runs/a: its record is removed; it stays, since it holds files" in said
    assert "removed 2 records" in said
    assert sorted(path.name for path in Path("runs").rglob("*") if path.parent.name != "c") == [
        "a", "c", "chapter.tex", "frames", "index.json"
    ]  # fmt: skip


@pytest.mark.parametrize(
    "command",
    [
        ("runs", "show"), ("runs", "export"), ("runs", "repair"), ("rerun",),
        ("explain",), ("runs", "compare", "a"),
    ],
)  # fmt: skip
def test_an_unknown_run_is_refused_in_words(
    capsys: pytest.CaptureFixture[str], command: tuple[str, ...]
) -> None:
    write(Path("runs/a"), SUCCEEDED)
    assert "no record 'nonsense'" in say(capsys, *command, "nonsense", status=2)


@pytest.mark.parametrize(
    "content", [b"", b"not an mcap file", b"\x89MCAP0\r\n" + b"\xff" * 100, b"\x89MCAP0\r\n"]
)
@pytest.mark.parametrize(
    "command", [("runs", "show"), ("rerun",), ("explain",), ("runs", "export")]
)
def test_a_foreign_or_broken_file_gets_words_and_no_traceback(
    capsys: pytest.CaptureFixture[str], command: tuple[str, ...], content: bytes
) -> None:
    Path("runs/odd").mkdir(parents=True)
    Path("runs/odd", EVENTS_FILE).write_bytes(content)
    capsys.readouterr()
    assert main([*command, "odd"]) in (0, 2)
    captured = capsys.readouterr()
    assert captured.out + captured.err
    assert "Traceback" not in captured.out + captured.err


def test_another_programs_mcap_is_refused_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    from mcap.writer import Writer

    with Path("foreign.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("other", "jsonschema", b"{}")
        channel = writer.register_channel("/events", "json", schema)
        writer.add_message(channel, 0, b'{"event": "Launched"}', 0)
        writer.finish()
    assert "'Launched' is no event of a run" in say(capsys, "explain", "foreign.mcap", status=2)
    assert say(capsys, "runs", "show", "foreign.mcap", status=2)


def test_a_slower_run_is_recorded_reported_and_repeated_as_such(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run("mocks.yaml", "--speed", "30 %")
    assert "at 30 % of the speed" in say(capsys, "explain", "last")
    assert "speed 30 %" in say(capsys, "runs", "show", "last")
    assert "✓ the same" in say(capsys, "rerun", "last")


@pytest.mark.parametrize("speed", ["0", "5 %", "150 %", "nan", "30"])
def test_an_impossible_speed_is_refused(capsys: pytest.CaptureFixture[str], speed: str) -> None:
    said = say(capsys, "run", "tree.yaml", "--dry", "mocks.yaml", "--speed", speed, status=2)
    assert said.startswith("--speed: ")
    assert "30 %" in said or "10 % to 100 %" in said
    assert not Path("runs").exists()
