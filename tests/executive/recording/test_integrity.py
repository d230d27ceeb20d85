"""A record is accepted as a whole or not at all: every byte is checked, and every problem is reported."""

from __future__ import annotations

import random
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest
import zstandard
from hypothesis import given, settings, strategies as st
from mcap.writer import Writer
from recorded_events import FAILED, everything, record, write

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.recording import recorder as recorder_module
from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import ENDING_FILE, EVENTS_FILE, why_cut
from pomona.executive.recording.index import RunIndex
from pomona.executive.recording.mcap_file import HEAD, MAGIC
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.scan import DamagedRecordError, examine
from pomona.executive.running.events import Event, RunEnded, StateChanged
from pomona.tools.dashboard.record_messages import image, overview, record_messages
from pomona.tools.library.export import export
from pomona.tools.library.repair import repair


@pytest.fixture
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "CHUNK_BYTES", 1000)


def run_of(number: int) -> list[Event]:
    return [
        *FAILED[:1],
        *(StateChanged(0.1 * i, i, "running", "x" * 200) for i in range(1, number)),
        *FAILED[-1:],
    ]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("whole"), everything())


@settings(max_examples=300)
@given(place=st.floats(0.0, 1.0, exclude_max=True), change=st.integers(1, 255))
def test_a_change_of_one_byte_anywhere_is_found(
    whole: Path, tmp_path_factory: pytest.TempPathFactory, place: float, change: int
) -> None:
    folder = tmp_path_factory.mktemp("changed")
    changed = bytearray(whole.read_bytes())
    changed[int(place * len(changed))] ^= change
    (folder / EVENTS_FILE).write_bytes(changed)
    found = digest(folder)
    assert found.state in ("damaged", "unreadable")  # unreadable: no longer an MCAP file at all
    assert found.outcome is None
    with pytest.raises(UsageError):
        list(read_events(folder))


@pytest.mark.long
def test_a_change_of_each_byte_of_a_small_record_is_found(tmp_path: Path) -> None:
    path = record(tmp_path, run_of(2))
    content = path.read_bytes()
    assert examine(path).state == "whole"
    assert examine(path).checked
    rng = random.Random(1)
    end = content.index(
        HEAD.pack(0x0F, 4)
    )  # behind it, every bit of every byte; before it, some of every third
    places = [(at, rng.randrange(1, 256)) for at in range(0, end, 3)]
    places += [(at, 1 << bit) for at in range(end, len(content)) for bit in range(8)]
    for at, change in places:
        path.write_bytes(content[:at] + bytes([content[at] ^ change]) + content[at + 1 :])
        try:
            assert examine(path).state == "damaged", (at, change)
        except UsageError:
            assert at < len(MAGIC)


def test_a_checksum_that_was_wiped_out_is_found_too(tmp_path: Path) -> None:
    path = record(tmp_path, run_of(2))
    content = path.read_bytes()
    summary = len(content) - len(MAGIC) - 4
    data = content.index(HEAD.pack(0x0F, 4)) + HEAD.size
    for at in (summary, data):
        path.write_bytes(content[:at] + bytes(4) + content[at + 4 :])
        assert examine(path).state == "damaged"


@settings(max_examples=200)
@given(
    cut=st.floats(0.0, 1.0), place=st.floats(0.0, 1.0, exclude_max=True), change=st.integers(1, 255)
)
def test_of_a_record_that_was_cut_off_no_changed_byte_is_believed(
    whole: Path, tmp_path_factory: pytest.TempPathFactory, cut: float, place: float, change: int
) -> None:
    folder = tmp_path_factory.mktemp("cut")
    content = whole.read_bytes()
    left = bytearray(content[: max(int(cut * len(content)), 1)])
    (folder / EVENTS_FILE).write_bytes(left)
    before = list(map(repr, read_events(folder)))
    left[int(place * len(left))] ^= change
    (folder / EVENTS_FILE).write_bytes(left)
    try:
        now = list(map(repr, read_events(folder)))
    except UsageError:
        return
    assert now == before[: len(now)]


def test_a_byte_that_turned_a_failure_into_a_success_is_believed_by_no_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write(Path("runs/odd"), FAILED) / EVENTS_FILE
    write(Path("runs/good"), FAILED)
    path.write_bytes(path.read_bytes().replace(b'"outcome":"failure"', b'"outcome":"success"'))
    for command in (
        ["runs", "show", "odd"], ["runs", "show", "odd", "--json"], ["explain", "odd"],
        ["rerun", "odd"], ["why", "odd"], ["runs", "compare", "good", "odd"], ["runs", "export", "odd", "odd.mcap"],
        ["runs", "export", "odd", "odd.jsonl"], ["runs", "export", "odd", "odd.zip"],
        ["runs", "export", "odd", "--to", "frames"],
    ):  # fmt: skip
        capsys.readouterr()
        assert main(command) == 2, command
        captured = capsys.readouterr()
        assert "damaged" in captured.err
        assert "does not match its checksum" in captured.err
        assert captured.out == ""
    assert not list(Path().glob("odd.*"))
    assert main(["runs", "list"]) == 0
    listed = capsys.readouterr().out
    assert "1 damaged" in listed
    assert "1 failure" in listed
    assert "success" not in listed
    for messages in (record_messages, overview):
        with pytest.raises(DamagedRecordError):
            list(messages(Path("runs/odd"), "/images/"))
    assert image(Path("runs/odd"), "0-0") is None


@pytest.mark.usefixtures("small_chunks")
def test_repair_keeps_everything_but_the_damaged_chunk_and_names_the_gap(tmp_path: Path) -> None:
    path = record(tmp_path, run_of(40))
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)
    done = repair(tmp_path)
    assert done is not None
    assert "does not match its checksum" in done.why
    ((_at, size, before, after),) = done.copied.gaps
    assert 500 < size < 2500
    events = list(read_events(tmp_path))
    missing = {event.tick for event in run_of(40)} - {event.tick for event in events}
    assert 1 <= len(missing) <= 5
    assert all(before <= 0.1 * tick <= after for tick in missing)
    assert isinstance(events[-1], RunEnded)
    assert digest(tmp_path).lost == done.copied.lost
    assert done.kept == "run.mcap.damaged"
    assert path.with_name(done.kept).read_bytes() == content
    assert repair(tmp_path) is None


@pytest.mark.usefixtures("small_chunks")
def test_a_record_of_which_the_first_chunk_is_lost_keeps_its_later_events(tmp_path: Path) -> None:
    path = record(tmp_path, run_of(40))
    content = bytearray(
        path.read_bytes()[: path.stat().st_size // 2]
    )  # and its summary is lost, too
    content[content.index(b"RunStarted")] ^= 1
    path.write_bytes(content)
    assert repair(tmp_path) is not None
    ticks = [event.tick for event in read_events(tmp_path)]
    assert len(ticks) > 5
    assert ticks == sorted(ticks)
    assert digest(tmp_path).tree == ""


@pytest.mark.slow
@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(st.floats(0.0, 1.0, exclude_max=True), st.integers(1, 255)),
        min_size=1,
        max_size=5,
    )
)
def test_a_repaired_record_is_whole_and_holds_no_event_that_was_not_recorded(
    whole: Path, tmp_path_factory: pytest.TempPathFactory, changes: list[tuple[float, int]]
) -> None:
    folder = tmp_path_factory.mktemp("repaired")
    path = folder / EVENTS_FILE
    changed = bytearray(whole.read_bytes())
    path.write_bytes(changed)
    recorded = list(map(repr, read_events(folder)))
    for place, change in changes:
        changed[len(MAGIC) + int(place * (len(changed) - len(MAGIC)))] ^= change
    path.write_bytes(changed)
    repair(folder)
    assert examine(path).state == "whole"
    assert set(map(repr, read_events(folder))) <= set(recorded)


# ------------------------------------------------------------------------------------------- the true cause


def test_the_cause_is_named_cut_killed_disk_full_lost_power(tmp_path: Path) -> None:
    path = record(tmp_path, run_of(3))
    size = path.stat().st_size
    path.write_bytes(path.read_bytes()[:-100])
    assert (
        why_cut(tmp_path)
        == f"it was whole once, with {size} bytes, and the file was cut afterwards"
    )

    script = (
        "import os, sys; from pathlib import Path; from pomona.executive.recording.recorder import Recorder;"
        "Recorder(Path(sys.argv[1])); os.kill(os.getpid(), 9)"
    )
    (tmp_path / "killed").mkdir()
    subprocess.run([sys.executable, "-c", script, str(tmp_path / "killed")], check=False)
    assert why_cut(tmp_path / "killed") == "the process was killed or crashed"
    ending = tmp_path / "killed" / ENDING_FILE
    ending.write_bytes(ending.read_bytes().replace(b'"boot":"', b'"boot":"another '))
    assert "lost its power" in why_cut(tmp_path / "killed")
    ending.write_bytes(b"\xff not JSON")
    assert why_cut(tmp_path / "killed", size=0) == "nothing was written (full disk?)"
    assert "killed or lost its power, or the file was cut" in why_cut(tmp_path / "killed")


def test_a_disk_that_is_full_is_named_as_the_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path)
    monkeypatch.setattr(recorder._writer, "flush", full_disk)
    recorder.on_event(FAILED[0])
    recorder.close()
    assert "No space left" in recorder.problem
    assert why_cut(tmp_path) == "it could not be written: No space left on device"
    assert digest(tmp_path).state == "cut off"
    assert "No space left" in (digest(tmp_path).message or "")


def full_disk() -> None:
    raise OSError(28, "No space left on device")


def test_zeros_at_the_end_are_a_loss_of_power_and_no_damage(tmp_path: Path) -> None:
    path = record(tmp_path, run_of(3))
    content = path.read_bytes()
    path.write_bytes(
        content[: content.index(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")] + bytes(4096)
    )
    verdict = examine(path)
    assert verdict.state == "cut off"
    assert "power failure" in verdict.why
    assert len(list(read_events(tmp_path))) == 4


# --------------------------------------------------------------------------------------------- hostile files


def chunked(records: bytes, compression: str, packed: bytes, size: int | None = None) -> bytes:
    """Return a file of one chunk with a given head."""
    head = struct.pack(
        "<QQQII",
        0,
        0,
        len(records) if size is None else size,
        zlib.crc32(records),
        len(compression),
    )
    chunk = head + compression.encode() + struct.pack("<Q", len(packed)) + packed
    header = HEAD.pack(1, 8) + bytes(8)
    return MAGIC + header + HEAD.pack(6, len(chunk)) + chunk


def test_a_compressed_bomb_is_refused_before_it_grows(tmp_path: Path) -> None:
    import tracemalloc

    bomb = zstandard.compress(bytes(400_000_000), 19)
    assert len(bomb) < 40_000
    for size in (400_000_000, 1000):  # what the head admits, and what it hides
        (tmp_path / EVENTS_FILE).write_bytes(chunked(b"", "zstd", bomb, size))
        tracemalloc.start()
        assert digest(tmp_path).state == "damaged"
        assert tracemalloc.get_traced_memory()[1] < 30_000_000
        tracemalloc.stop()


def test_a_length_that_a_file_only_claims_costs_nothing(tmp_path: Path) -> None:
    for opcode in (0x05, 0x06, 0x09, 0x0C):
        for length in (2**31, 2**63 - 1, 2**64 - 1):
            (tmp_path / EVENTS_FILE).write_bytes(
                MAGIC + HEAD.pack(1, 8) + bytes(8) + HEAD.pack(opcode, length)
            )
            assert digest(tmp_path).state == "cut off"
    assert repair(tmp_path) is not None


def test_links_in_a_record_are_not_followed(tmp_path: Path) -> None:
    real = write(tmp_path / "real", FAILED)
    trap = tmp_path / "trap"
    trap.mkdir()
    (trap / EVENTS_FILE).symlink_to(real / EVENTS_FILE)
    (trap / "picture.png").symlink_to("/etc/passwd")
    entries = {run.run: run for run in RunIndex(tmp_path).read()}
    assert entries["trap"].state == "unreadable"
    assert "is a link" in (entries["trap"].message or "")
    assert not entries["trap"].picture
    (trap / EVENTS_FILE).unlink()
    record(trap, list(FAILED))
    export(trap, tmp_path / "out.zip")
    import zipfile

    with zipfile.ZipFile(tmp_path / "out.zip") as archive:
        assert "trap/picture.png" not in archive.namelist()


def test_a_pipe_in_place_of_a_record_does_not_hold_the_list_up(tmp_path: Path) -> None:
    import os

    (tmp_path / "pipe").mkdir()
    os.mkfifo(tmp_path / "pipe" / EVENTS_FILE)
    (entry,) = RunIndex(tmp_path).read()
    assert entry.state == "unreadable"


@pytest.mark.parametrize("name", ["foreign", "text", "damaged"])
def test_a_file_that_is_no_valid_record_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write(Path("runs") / name, FAILED) / EVENTS_FILE
    if name == "foreign":
        with path.open("wb") as output:
            writer = Writer(output)
            writer.start()
            channel = writer.register_channel("/chatter", "json", 0)
            writer.add_message(channel, 1, b'{"text":"hello"}', 1)
            writer.finish()
    else:
        content = path.read_bytes()
        path.write_bytes(
            b"# notes of the day" if name == "text" else content[:-60] + b"?" + content[-59:]
        )
    assert main(["explain", name]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert ("damaged" if name == "damaged" else "not a record of a run") in captured.err


def test_an_index_that_names_a_chunk_many_times_is_refused(tmp_path: Path) -> None:
    content = record(tmp_path, run_of(3)).read_bytes()
    footer = content[-29 - len(MAGIC) : -len(MAGIC)]
    start = int.from_bytes(footer[9:17], "little")
    summary = content[start : -29 - len(MAGIC)]
    at = 0
    while summary[at] != 0x08:  # the first chunk index
        at += HEAD.size + int.from_bytes(summary[at + 1 : at + 9], "little")
    end = at + HEAD.size + int.from_bytes(summary[at + 1 : at + 9], "little")
    forged = summary[:end] + 1000 * summary[at:end] + summary[end:]
    head = footer[:17] + bytes(8)
    crc = struct.pack("<I", zlib.crc32(forged + head))
    (tmp_path / EVENTS_FILE).write_bytes(content[:start] + forged + head + crc + MAGIC)
    assert examine(tmp_path / EVENTS_FILE).state == "whole"
    assert digest(tmp_path).state == "damaged"
    with pytest.raises(DamagedRecordError, match="overlap"):
        list(read_events(tmp_path))


@pytest.mark.parametrize("start", [1, 2**31, 2**63, 2**64 - 1])
def test_a_footer_that_points_nowhere_is_damage(tmp_path: Path, start: int) -> None:
    path = record(tmp_path, run_of(3))
    content = path.read_bytes()
    place = len(content) - len(MAGIC) - 20
    path.write_bytes(content[:place] + struct.pack("<Q", start) + content[place + 8 :])
    assert examine(path).state == "damaged"
