"""The distribution `pomona-executive`: the executive in an environment that holds nothing but its own requirements."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import venv
from collections.abc import Iterator, Mapping
from importlib.metadata import Distribution, EntryPoint, distribution
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple
from zipfile import ZipFile

import pytest
from packaging.requirements import Requirement

from pomona.executive.commands import command_line
from pomona.executive.errors import UsageError
from pomona.executive.values.installation import install_extra, need, pip, reinstall, remedy

ROOT = Path(__file__).parents[2]
TREES = ROOT / "executive" / "trees"
SIM = ROOT / "trees" / "cells" / "sim.yaml"

MOST = 120e6
"""Bytes of the distribution and all that it requires."""

PICTURE = """
import numpy as np
from pathlib import Path
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import Published
from pomona.executive.views import ImageView
Path("record").mkdir()
recorder = Recorder(Path("record"))
recorder.on_event(Published(0.5, 25, "Look", "look", ImageView(np.zeros((4, 4, 3), np.uint8))))
recorder.close()
print(recorder.problem)
"""

PAGE = """
import urllib.request
from pathlib import Path
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard
dashboard = Dashboard(Access("127.0.0.1", {port}), Path("runs"))
dashboard.start()
print(urllib.request.urlopen("http://127.0.0.1:{port}/").status)
dashboard.close()
"""

OVEN = '''
from dataclasses import dataclass
from typing import Protocol

from pomona.executive import (
    ConnectContext, Device, DeviceFault, Outputs, Settings, Skill, Time, Work, command, driver, stamped
)
from pomona.executive.values.kinds import Number
from pomona.executive.values.sections import value


@dataclass(frozen=True)
class Temperature:
    stamp: float
    celsius: float


class Oven(Protocol):
    @stamped
    def latest(self) -> Temperature: ...

    @command
    def heat(self, on: bool) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class OvenOptions:
    start: float = value(Number(-50.0, 500.0), "20", "temperature when it is connected, in degrees Celsius")
    rate: float = value(Number(0.0, 100.0), "20", "degrees Celsius per second while it heats")


class ModelOven(Device):
    interfaces = (Oven,)
    LIMIT = 200.0

    def __init__(self, options, clock, name):
        super().__init__(name)
        self._options, self._clock = options, clock
        self._celsius, self._since, self._on = options.start, clock.now(), False

    def latest(self):
        now = self._clock.now()
        self._celsius += self._on * self._options.rate * (now - self._since)
        self._since = now
        return Temperature(now, self._celsius)

    def heat(self, on):
        self.latest()
        self._on = on

    def check(self):
        if self.latest().celsius > self.LIMIT:
            raise DeviceFault(self.name, f"is hotter than {self.LIMIT:g} degrees")

    def safe_stop(self, reason):
        self.heat(False)
        print("the heating is off:", reason, flush=True)

    def settled(self):
        return not self._on

    def close(self):
        print("the oven is released", flush=True)


@driver(ModelOven, OvenOptions)
def connect(settings: Settings[OvenOptions], context: ConnectContext) -> ModelOven:
    return ModelOven(settings.values, context.clock, settings.name)


class Heated(Outputs):
    celsius: float


class Heat(Skill):
    """Heat the oven for a while."""

    devices = (Oven,)

    def run(self, duration: Time = 0.5) -> Work[Heated]:
        oven = self.device(Oven)
        oven.heat(True)
        yield from self.wait(duration)
        oven.heat(False)
        return Heated(oven.latest().celsius)
'''
"""A package of somebody else: a device that moves something, and a skill that commands it."""

OVEN_POINTS = """[pomona.drivers]
model-oven = oven:connect
[pomona.skills]
Heat = oven:Heat
"""

OVEN_CELL = """name: kitchen
kind: mock
options: {start: "20"}
devices:
  oven: {driver: model-oven, start: "{start}"}
"""

BAKE = """pomona: 1
tree: bake
root: {Heat: {duration: 500 ms, celsius: "{warmth}"}}
"""


def project(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    return found


def required(names: Mapping[str, None]) -> Iterator[Distribution]:
    """Yield installed distributions of these names, and their requirements."""
    waiting, seen = list(names), set[str]()
    while waiting:
        name = waiting.pop()
        if name.lower() in seen:
            continue
        seen.add(name.lower())
        found = distribution(name)
        yield found
        for line in found.requires or ():
            requirement = Requirement(line)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                waiting.append(requirement.name)


class Alone:
    """An environment with the wheel of `executive/` and its requirements."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        subprocess.run(
            [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder / "dist")],
            cwd=ROOT / "executive",
            check=True,
            capture_output=True,
        )
        (wheel,) = (folder / "dist").iterdir()
        venv.create(folder / "env", symlinks=True)
        (site,) = folder.glob("env/lib/*/site-packages")
        with ZipFile(wheel) as archive:
            archive.extractall(site)
            self.size = sum(member.file_size for member in archive.infolist())
            self.names = {member.filename.partition("/")[0] for member in archive.infolist()}
        declared = dict.fromkeys(
            Requirement(line).name for line in project(ROOT / "executive")["dependencies"]
        )
        for needed in required(declared):
            assert needed.files is not None
            files = [
                file
                for file in needed.files
                if ".." not in file.parts and "__pycache__" not in file.parts
            ]
            self.size += sum(Path(str(file.locate())).stat().st_size for file in files)
            for top in {file.parts[0] for file in files}:
                if not (site / top).exists():
                    (site / top).symlink_to(Path(str(needed.locate_file(top))))

    def python(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run Python there, without this process' search path."""
        return subprocess.run(
            [self.folder / "env" / "bin" / "python", *arguments],
            cwd=self.folder,
            env={"HOME": str(self.folder)},
            capture_output=True,
            text=True,
            check=False,
        )

    def pomona(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run the command there."""
        return self.python(
            "-c", "import sys; from pomona.executive.cli import main; sys.exit(main())", *words
        )


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Alone:
    return Alone(tmp_path_factory.mktemp("alone"))


@pytest.mark.slow
def test_it_adds_one_name_and_fits_its_bound(alone: Alone) -> None:
    assert alone.names == {"pomona", "pomona_executive-0.1.0.dist-info"}
    assert alone.size < MOST


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("--version",),
        ("check", "count_down"),
        ("fmt", "--check", str(TREES / "count_down.yaml")),
        ("show", "count_down"),
        ("schema",),
        ("skills",),
        ("completion", "bash"),
        ("run", "count_down", "--dry"),
        ("run", "--help"),
    ],
    ids=lambda words: words[0],
)
def test_commands_work_without_robots_and_fruit(alone: Alone, words: tuple[str, ...]) -> None:
    done = alone.pomona(*words)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_run_is_recorded_and_explained(alone: Alone) -> None:
    assert alone.pomona("run", "count_down", "--record", "kept").returncode == 0
    assert "It succeeded after 2." in alone.pomona("explain", "last", "--record", "kept").stdout


@pytest.mark.slow
def test_a_tree_of_py_trees_runs_and_the_page_answers(alone: Alone, free_port: int) -> None:
    done = alone.python(str(ROOT / "examples" / "show_py_trees.py"))
    assert done.stdout.startswith("success after 2."), done.stderr
    assert alone.python("-c", PAGE.format(port=free_port)).stdout.strip() == "200"


@pytest.fixture
def free_port() -> int:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port: int = taken.getsockname()[1]
        return port


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("lsp",), "pomona lsp needs the extra 'lsp': {pip} install 'pomona-executive[lsp]'"),
        (
            ("campaign", "c.yaml"),
            "pomona campaign needs the extra 'pictures': {pip} install 'pomona-executive[pictures]'",
        ),
        (
            ("doctor",),
            "pomona doctor: the distribution pomona has this command: install it in an environment of its own, without "
            "pomona-executive",
        ),
        (("new", "driver", "scale"), "pomona new driver: the distribution pomona has this kind"),
        (
            ("skills", "Plan"),
            "No skill is installed here: `pomona new skill NAME` begins a package with one.",
        ),
        (("check", "pick_apple"), "no tree file 'pick_apple'; installed: count_down"),
        (
            ("run", "count_down", "--cell", str(ROOT / "trees" / "cells" / "sim.yaml")),
            "this installation has no drivers",
        ),
    ],
    ids=["lsp", "campaign", "doctor", "driver", "skill", "tree", "cell"],
)
def test_missing_parts_are_named(alone: Alone, words: tuple[str, ...], says: str) -> None:
    done = alone.pomona(*words)
    assert done.returncode == 2
    assert says.format(pip=f"{alone.folder / 'env' / 'bin' / 'python'} -m pip") in " ".join(
        done.stderr.split()
    )
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_an_image_that_cannot_be_coded_is_a_problem_of_the_record_that_names_the_extra(
    alone: Alone,
) -> None:
    said = alone.python("-c", PICTURE).stdout
    assert said.startswith("the record lacks an event at 0.50 s of the run")
    assert "-m pip install 'pomona-executive[pictures]'" in said


@pytest.mark.slow
def test_a_package_begun_here_requires_neither_distribution_and_its_kinds_are_those_of_the_help(
    alone: Alone,
) -> None:
    assert alone.pomona("new", "skill", "Weigh").returncode == 0
    begun = tomllib.loads((alone.folder / "weigh" / "pyproject.toml").read_text("utf-8"))["project"]
    assert begun["dependencies"] == []
    helped = alone.pomona("new", "--help").stdout
    assert "{node,package,skill,tree}" in helped
    assert not [word for word in ("driver", "fruit", "camera") if word in helped]
    assert alone.pomona("skills").stdout.startswith("No skill is installed here")


@pytest.mark.slow
def test_a_dry_run_is_repeated_from_its_record(alone: Alone) -> None:
    assert alone.pomona("run", "count_down", "--dry", "--record", "dry").returncode == 0
    done = alone.pomona("rerun", "last", "--record", "dry")
    assert done.returncode == 0, done.stderr


def test_both_distributions_agree() -> None:
    part, whole = project(ROOT / "executive"), project(ROOT)
    for key in ("version", "requires-python", "license", "scripts"):
        assert part[key] == whole[key], key
    assert set(part["dependencies"]) <= set(whole["dependencies"])
    pictures = part["optional-dependencies"].pop("pictures")
    assert set(pictures) <= set(whole["dependencies"])
    assert part["optional-dependencies"].items() <= whole["optional-dependencies"].items()
    for group, points in part["entry-points"].items():
        theirs = whole["entry-points"][group]
        for name, target in points.items():
            assert target == theirs[name], name


def test_commands_that_the_part_lacks_are_listed() -> None:
    part, whole = project(ROOT / "executive")["entry-points"], project(ROOT)["entry-points"]
    commands = whole["pomona.commands"].keys() - part["pomona.commands"].keys()
    assert commands == set(command_line.ELSEWHERE)


class Named(NamedTuple):
    """A distribution."""

    name: str


def test_both_distributions_in_one_environment_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def points(group: str) -> list[EntryPoint]:
        return [
            SimpleNamespace(name="run", dist=Named(name))  # type: ignore[misc]
            for name in ("pomona", "pomona-executive")
        ]

    monkeypatch.setattr(command_line, "entry_points", points)
    words = f"are both installed here and hold the same files: {pip()} uninstall pomona-executive, then "
    with pytest.raises(UsageError, match=re.escape(words + reinstall("pomona"))):
        command_line.make_parser(["run"])


def test_a_missing_package_is_reported_with_the_command_that_installs_it() -> None:
    with pytest.raises(
        UsageError,
        match=re.escape(f"sums needs the extra 'sums': {install_extra('sums')} (No module"),
    ):
        need("no_such_module", "sums", "sums")
    assert remedy("pygls.lsp") == install_extra("lsp")
    assert remedy("no_such_module") == "pomona doctor"


@pytest.fixture(scope="module")
def with_oven(tmp_path_factory: pytest.TempPathFactory) -> Alone:
    """An environment that holds somebody else's package as well, with a tree and a cell in its folder."""
    alone = Alone(tmp_path_factory.mktemp("oven"))
    (site,) = alone.folder.glob("env/lib/*/site-packages")
    (site / "oven.py").write_text(OVEN)
    points = site / "oven-1.0.dist-info" / "entry_points.txt"
    points.parent.mkdir()
    points.write_text(OVEN_POINTS)
    (points.parent / "METADATA").write_text("Metadata-Version: 2.1\nName: oven\nVersion: 1.0\n")
    (alone.folder / "kitchen.yaml").write_text(OVEN_CELL)
    (alone.folder / "bake.yaml").write_text(BAKE)
    return alone


@pytest.mark.slow
def test_a_device_of_somebody_else_is_checked_connected_commanded_and_released(
    with_oven: Alone,
) -> None:
    assert with_oven.pomona("check", "bake.yaml", "kitchen.yaml").returncode == 0
    done = with_oven.pomona("run", "bake.yaml", "--cell", "kitchen.yaml", "--record", "kept")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("the oven is released") == 1
    assert "the heating is off" not in done.stdout
    assert "It succeeded" in with_oven.pomona("explain", "last", "--record", "kept").stdout


@pytest.mark.slow
def test_a_fault_of_that_device_ends_the_run_in_its_safe_state(with_oven: Alone) -> None:
    done = with_oven.pomona(
        "run", "bake.yaml", "--cell", "kitchen.yaml", "--set", "start=199", "--record", "hot"
    )
    assert done.returncode == 3, done.stdout + done.stderr
    assert done.stdout.count("the heating is off: oven: is hotter than 200 degrees") == 1
    assert done.stdout.index("the heating is off") < done.stdout.index("the oven is released")


@pytest.mark.slow
def test_a_wrong_option_or_a_workspace_is_an_error_at_its_place(with_oven: Alone) -> None:
    path = with_oven.folder / "wrong.yaml"
    path.write_text(
        OVEN_CELL.replace('"{start}"', "900") + "workspace: {lower: [0, 0, 0], upper: [1, 1, 1]}\n"
    )
    done = with_oven.pomona("run", "bake.yaml", "--cell", "wrong.yaml")
    said = " ".join(done.stderr.split())
    assert done.returncode == 2
    assert "wrong.yaml:5:37" in said
    assert "wrong.yaml:6:12" in said
    assert "nothing installed here describes surroundings" in said
    assert "Traceback" not in said
