"""Commands that move nothing work where modules and names of Linux are missing, as on Windows and macOS."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]

HIDING = """
import asyncio  # a system without fcntl has another event loop
import importlib.abc, json, os, signal, sys, time
modules, names, commands = map(json.loads, sys.argv[1:4])


class Hidden(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


for name in [name for name in sys.modules if name.partition(".")[0] in modules]:
    del sys.modules[name]
sys.meta_path.insert(0, Hidden())
for name in names:
    owner, _, attribute = name.rpartition(".")
    if hasattr(sys.modules[owner], attribute):
        delattr(sys.modules[owner], attribute)
from pomona.executive.cli import main

for words in commands:
    try:
        status = main(words)
    except SystemExit as ended:
        status = ended.code
    if not sys.stdout.closed:
        sys.stdout.flush()
    os.write(2, f"STATUS {words[0]} {status}\\n".encode())
"""
"""Hides modules and attributes, then runs commands in this process."""

UNIX_MODULES = ("fcntl", "termios", "resource", "tty", "pty", "pwd", "grp")
UNIX_NAMES = (
    "signal.SIGHUP", "signal.SIGCHLD", "signal.pthread_sigmask", "time.clock_gettime", "time.CLOCK_BOOTTIME",
    "time.CLOCK_MONOTONIC", "os.O_NOFOLLOW", "os.O_NONBLOCK", "os.sched_getaffinity", "os.fork",
)  # fmt: skip
GRAPHICS = ("OpenGL", "pyrender")
PLANNER = ("ompl",)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A record, RGB-D frames without fruit, and a picture with fruit."""
    folder = tmp_path_factory.mktemp("other_systems")
    code = "import sys; from pomona.executive.cli import main; sys.exit(main(sys.argv[1:]))"
    tree = str(ROOT / "executive" / "trees" / "count_down.yaml")
    subprocess.run(
        [sys.executable, "-c", code, "run", tree, "--dry"],
        cwd=folder,
        capture_output=True,
        check=True,
    )
    frames = folder / "frames"
    frames.mkdir()
    cv2.imwrite(str(frames / "a_color.png"), np.full((120, 160, 3), 90, np.uint8))
    cv2.imwrite(str(frames / "a_depth_mm.png"), np.full((120, 160), 900, np.uint16))
    (frames / "intrinsics.yaml").write_text(
        "{fx: 300 px, fy: 300 px, cx: 80 px, cy: 60 px, width: 160, height: 120}"
    )
    (frames / "frames.json").write_text(
        json.dumps([{"label": "a", "T_base_camera": np.eye(4).tolist()}])
    )
    return folder


QUICK = (
    ("check", "pick_apple"),
    ("fmt", "--check", str(ROOT / "trees" / "pick_apple.yaml")),
    ("show", "pick_apple"),
    ("schema",),
    ("explain", "last"),
    ("lsp",),  # the last one: it closes the streams
)

OPENED = {
    "uri": "file:///t.yaml",
    "languageId": "yaml",
    "version": 1,
    "text": "pomona: 1\ntree: t\nroot: {wait: 1 m}\n",
}
EDITOR = (
    {
        "id": 1,
        "method": "initialize",
        "params": {"processId": None, "rootUri": None, "capabilities": {}},
    },
    {"method": "initialized", "params": {}},
    {"method": "textDocument/didOpen", "params": {"textDocument": OPENED}},
    {"id": 2, "method": "shutdown"},
    {"method": "exit"},
)
"""Messages of an editor that opens a tree with a mistake."""


def typed(messages: tuple[dict[str, object], ...]) -> str:
    """Messages as they stand on the language server's input."""
    texts = [json.dumps({"jsonrpc": "2.0", **message}) for message in messages]
    return "".join(f"Content-Length: {len(text)}\r\n\r\n{text}" for text in texts)


def run(
    folder: Path, out: str, modules: tuple[str, ...], names: tuple[str, ...] = (), slow: bool = True
) -> None:
    measured = ("measure", "frames", "--out", f"measured_{out}")
    detected = (
        "detect",
        str(ROOT / "docs" / "images" / "rendered.jpg"),
        "--out",
        f"detected_{out}",
    )
    commands = (measured, detected, *QUICK) if slow else QUICK
    done = subprocess.run(
        [sys.executable, "-c", HIDING, *map(json.dumps, (modules, names, commands))],
        cwd=folder,
        input=typed(EDITOR),
        capture_output=True,
        text=True,
        check=False,
    )
    assert "textDocument/publishDiagnostics" in done.stdout
    assert '"severity": 1' in done.stdout
    ended = [line for line in done.stderr.splitlines() if line.startswith("STATUS")]
    assert ended == [f"STATUS {words[0]} 0" for words in commands], done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("module", ["fcntl", "termios", "resource", "tty"])
def test_without_a_module_of_unix(folder: Path, module: str) -> None:
    run(folder, module, (module,), slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["signal.SIGHUP", "time.clock_gettime", "os.O_NOFOLLOW"])
def test_without_a_name_of_unix(folder: Path, name: str) -> None:
    run(folder, name, (), (name,), slow=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "modules", "names"),
    [
        ("windows", UNIX_MODULES, UNIX_NAMES),
        ("no graphics", GRAPHICS, ()),
        ("no planner", PLANNER, ()),
    ],
    ids=["windows", "egl", "ompl"],
)
def test_fruit_is_measured_and_found(
    folder: Path, case: str, modules: tuple[str, ...], names: tuple[str, ...]
) -> None:
    run(folder, case.replace(" ", "_"), modules, names)
