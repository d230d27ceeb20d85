"""Missing parts of a machine are reported, with their installation."""

from __future__ import annotations

import errno
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from pomona.drivers.errors import DeviceFault
from pomona.executive.values.installation import install_extra
from pomona.executive.values.sentences import ReportLine
from pomona.tools.calibration import machine
from pomona.tools.calibration.machine import examine_machine


def lines(records: Path = Path("runs")) -> dict[str, ReportLine]:
    return {line.name: line for line in examine_machine(records)}


def test_a_complete_machine_passes_and_names_its_renderer(tmp_path: Path) -> None:
    found = lines(tmp_path / "runs")
    assert [line for line in found.values() if not line.ok] == []
    assert found["EGL"].found.startswith("renders with ")
    assert str(tmp_path / "runs") in found["folder of records"].found
    assert not (tmp_path / "runs").exists()


def test_every_package_that_is_declared_is_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = machine.version

    def version(package: str) -> str:
        if package in ("orjson", "py-trees"):
            raise machine.PackageNotFoundError(package)
        return whole(package)

    monkeypatch.setattr(machine, "version", version)
    found = lines()
    assert not found["orjson"].ok
    assert "pip install 'orjson<" in found["orjson"].advice
    assert "pip install 'py-trees" in found["py-trees"].advice
    assert found["zstandard"].ok


def test_a_library_of_the_system_that_a_package_lacks_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(name: str, **_environment: str) -> object:
        raise OSError(f"lib{name}.so.1: cannot open shared object file")

    monkeypatch.setattr("pomona.tools.calibration.machine.import_under", refuse)
    monkeypatch.setattr(
        machine, "requires", lambda _: ["onnxruntime>=1.20", "pyrender==0.1.45", "numpy>=2.0"]
    )
    found = lines()
    assert "libonnxruntime.so.1" in found["onnxruntime"].found
    assert "a library of the system" in found["onnxruntime"].advice
    assert "libegl1" in found["pyrender"].advice
    assert found["numpy"].ok


def test_a_package_that_lacks_another_one_is_sent_to_pip_and_not_to_apt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(name: str, **_environment: str) -> object:
        raise ModuleNotFoundError("No module named 'trimesh.base'", name="trimesh.base")

    monkeypatch.setattr("pomona.tools.calibration.machine.import_under", refuse)
    assert lines()["pyrender"].advice.endswith("pip install trimesh")


def test_graphics_that_draw_nothing_are_reported_with_the_package_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> object:
        raise DeviceFault("camera", "no EGL display")

    monkeypatch.setattr("pomona.tools.simulation.gl.open_renderer", refuse)
    found = lines()["EGL"]
    assert not found.ok
    assert "no EGL display" in found.found
    assert "apt install libegl1" in str(found)


def test_a_machine_without_a_browser_is_reported_and_no_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pomona.tools.calibration.machine.shutil.which", lambda _name: None)
    found = lines()["browser for tests"]
    assert found.ok
    assert "apt install chromium" in found.found


def test_a_read_only_folder_and_a_full_one_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = tmp_path / "runs"
    monkeypatch.setattr(machine, "ROOM", 1e30)
    assert not lines(full)["folder of records"].ok

    def refuse(**_: object) -> object:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr("pomona.tools.calibration.machine.tempfile.TemporaryFile", refuse)
    found = lines(full)["folder of records"]
    assert not found.ok
    assert "Read-only file system" in found.found
    assert "--record DIR" in found.advice


def test_it_lists_installed_extras_and_the_commands_for_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def version(package: str) -> str:
        if package == "eclipse-zenoh":
            raise machine.PackageNotFoundError(package)
        return "1.2"

    monkeypatch.setattr(machine, "version", version)
    found = {line.name: line for line in machine._extras()}
    assert all(line.ok for line in found.values())
    assert found["extra ros2"].found == f"not installed; {install_extra('ros2')}"
    assert found["extra lerobot"].found == "pyarrow 1.2"
    project = tomllib.loads((Path(__file__).parents[4] / "pyproject.toml").read_text("utf-8"))[
        "project"
    ]
    assert set(machine.EXTRAS) == set(project["optional-dependencies"]) - {"dev"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "words"), [("numpy", ("run", "pick_apple")), ("yaml", ("check", "pick_apple"))]
)
def test_without_a_base_package_the_doctor_runs_and_the_other_commands_name_it(
    module: str, words: tuple[str, ...], tmp_path: Path
) -> None:
    def typed(*words: str) -> subprocess.CompletedProcess[str]:
        script = f"import sys; sys.modules['{module}'] = None\n"
        script += f"from pomona.executive.cli import main; sys.exit(main({words!r}))"
        return subprocess.run(
            [sys.executable, "-c", script],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )

    done = typed("doctor")
    assert done.returncode == 1, done.stderr
    assert f"not examined, since a requirement is missing: import of {module} halted" in done.stdout
    assert "Traceback" not in done.stderr
    done = typed(*words)
    assert done.returncode == 2
    assert f"the package {module} is not installed; run: pomona doctor" in done.stderr
    assert "Traceback" not in done.stderr
