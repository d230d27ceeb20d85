"""A device, a pipe or an endless file in place of a text is refused at once, by every command."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from recorded_events import started, write

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.files import read_text
from pomona.executive.values.plain_text import MOST_BYTES, NoTableError, read_plain_text, read_table


@pytest.mark.parametrize(
    "command",
    [
        ["check"], ["run", "--dry", "--no-record"], ["campaign"], ["fmt"], ["test"], ["import"],
        ["evidence", "odd", "--hazards"],
    ],
)  # fmt: skip
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full", "pipe"])
def test_no_command_waits_for_a_device_or_a_pipe(
    command: list[str],
    device: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    write(Path("runs/odd"), (started(),))
    assert main([*command, device]) in (1, 2)
    said = capsys.readouterr()
    assert device in said.out + said.err
    assert "Traceback" not in said.out + said.err


def test_a_file_that_is_too_long_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "long.yaml"
    path.touch()
    os.truncate(path, MOST_BYTES + 1)
    with pytest.raises(UsageError, match="Larger than 16384 KiB"):
        read_text(path)


def test_a_link_to_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "there.yaml").write_text("a: 1\r\n")
    (tmp_path / "here.yaml").symlink_to("there.yaml")
    assert read_text(tmp_path / "here.yaml") == "a: 1\n"


LONG = "x" * 300
FILES = {
    "cell.yaml": f"name: lab\nworkspace: {{include: {LONG}.yaml}}\n",
    "scenario.yaml": f"pomona: 1\nscenario: x\ntree: {LONG}.yaml\ncases: []\n",
    "campaign.yaml": f"campaign: x\ntree: {LONG}\ncell: {LONG}\n",
}


@pytest.mark.parametrize(
    "command",
    [
        *(
            ["check", "pick_apple", "--cell", "cell.yaml"],
            ["test", "scenario.yaml"],
            ["campaign", "campaign.yaml"],
        ),
        *(
            ["check", LONG],
            ["run", LONG],
            ["check", "pick_apple", "--cell", LONG],
            ["explain", LONG],
        ),
        *(
            ["check", "pick_apple", "--set", f"fruit={LONG}"],
            ["runs", "export", LONG],
            ["fmt", LONG],
        ),
    ],
    ids=lambda command: "_".join(word[:12] for word in command),
)
def test_a_longer_name_than_a_file_can_have_is_a_file_that_is_not_there(
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text)
    assert main(command) == 2
    said = capsys.readouterr()
    assert "Traceback" not in said.out + said.err
    assert said.out + said.err


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path: Path) -> None:
    (file := tmp_path / "notes.txt").write_bytes("\ufeff0 0.5\r\n".encode())
    assert read_plain_text(file) == "0 0.5\n"


def test_rows_of_a_table_have_the_numbers_of_their_lines(tmp_path: Path) -> None:
    (file := tmp_path / "fruit.csv").write_bytes(
        '\ufeffimage,x\r\na.jpg,1\r\n\r\n"b, c.jpg",2\r\n'.encode()
    )
    assert read_table(file, ["image"]) == [
        (2, {"image": "a.jpg", "x": "1"}),
        (4, {"image": "b, c.jpg", "x": "2"}),
    ]


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"image;x\na.jpg;1\n", "not parted by commas"),
        (b"image\tx\na.jpg\t1\n", "not parted by commas"),
        (b"picture,x\n", "has no column image"),
        (b"image,x,image\n", "has the column image twice"),
        (b"", "has no column image"),
        (b"\xff\xfei\x00", "it is UTF-16"),
        (b"image,x\na\xe9.jpg,1\n", "byte 9 is not UTF-8"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_the_reason(
    content: bytes, reason: str, tmp_path: Path
) -> None:
    (file := tmp_path / "fruit.csv").write_bytes(content)
    with pytest.raises(NoTableError, match=reason):
        read_table(file, ["image"])


def test_an_absent_table_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "absent.csv"):
        with pytest.raises(NoTableError, match="irectory"):
            read_table(path, ["image"])
