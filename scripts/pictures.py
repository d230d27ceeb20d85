"""The pictures of the README and of the documentation, made again by `make figures`, with their sources.

    python -m scripts.pictures                # those whose sources have changed since they were made
    python -m scripts.pictures pick.webp …    # these
    python -m scripts.pictures --check        # names those that are behind, and makes nothing

`docs/images/made.json` has for every picture the command, the commit and a digest of its source files; a test computes
the digests anew. A picture that comes out as it was, with the same figures, stays as it is, byte for byte: only its
entry records the check.
"""

from __future__ import annotations

import argparse
import ast
import atexit
import hashlib
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from PIL import Image

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.recording.digest import digest
from pomona.executive.values.installation import commit_here

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
LEDGER = IMAGES / "made.json"

PICK: dict[str, Any] = {
    "tree": "pick_apple",
    "cell": "sim",
    "seed": 5,
    "settings": {"fruit": "apple_4", "place": "2"},
}
"""The run that pictures of a pick show; a test makes the same one, and holds its figures against the ledger's."""

SAME = 2.0
"""Pictures that differ less on average, seen from afar, are the same [of 255]."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of the documentation.

    Attributes:
        make: writes it to a file.
        sources: patterns of the files that decide how it looks.
        shows: the figures that can be read off it; tests compute them anew.
    """

    make: Callable[[Path], None]
    sources: tuple[str, ...]
    shows: Callable[[], dict[str, Any]] | None = None


def order(records: Path) -> RunOrder:
    """To carry out the run."""
    return RunOrder(
        find_tree(PICK["tree"]),
        find_cell(PICK["cell"]),
        PICK["seed"],
        PICK["settings"],
        record=records,
    )


@cache
def pick() -> Path:
    """Carry out the run, once in this process; its record."""
    records = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, records)
    record = execute(order(Path(records))).record
    assert record is not None
    return record


def figures_of_pick() -> dict[str, Any]:
    """Return the numbers of a picture of the run: its end, its length and the greatest of each curve."""
    run = digest(pick())
    peaks = {name: float(f"{peak:.3g}") for name, peak in sorted(run.peaks.items())}
    return {"outcome": run.outcome, "time [s]": run.time, **peaks}


def run_picture(out: Path) -> None:
    """The picture that a run leaves."""
    out.write_bytes((pick() / "picture.png").read_bytes())


def page_animation(out: Path) -> None:
    """The operator's page, playing a record."""
    from scripts.screenshots import main as photograph

    photograph(out.parent, out)


VIEW = {"azimuth": 142.0, "elevation": -12.0, "distance": 1.06}
"""Place from which the arm with the lifted apple is seen, around the apple [°, °, m]."""


def lifted_apple(out: Path) -> None:
    """The arm at the end of the run, with the apple in its fingers, seen from a place beside the table."""
    from pomona.tools.simulation.gl import in_gl_thread
    from pomona.tools.simulation.world import SimWorld

    truth = SimWorld.truth
    seen: list[Any] = []

    def photographed(world: SimWorld) -> Any:
        if not seen:
            seen.append(in_gl_thread(lambda: _photograph(world)))
        return truth(world)

    with (
        tempfile.TemporaryDirectory() as records,
        mock.patch.object(SimWorld, "truth", photographed),
    ):
        execute(order(Path(records)))
    Image.fromarray(seen[0]).resize((1280, 640), Image.Resampling.LANCZOS).save(out, quality=88)


def _photograph(world: Any) -> Any:
    """Return a view of the whole world on light grey, twice as large as the picture: smoother edges."""
    from pomona.tools.simulation.gl import open_renderer

    shown = world.model.vis
    shown.global_.offwidth, shown.global_.offheight = 2560, 1280
    shown.headlight.ambient[:], shown.headlight.diffuse[:] = 0.3, 0.35
    camera = world.mujoco.MjvCamera()
    for name, value in VIEW.items():
        setattr(camera, name, value)
    camera.lookat[:] = np.add(world.state.body("fruit_0").xpos, (0.0, 0.0, 0.16))
    renderer = open_renderer(world.model, 1280, 2560)
    renderer.update_scene(world.state, camera)
    picture = renderer.render().copy()
    renderer.enable_segmentation_rendering()
    planes = np.flatnonzero(world.model.geom_type == world.mujoco.mjtGeom.mjGEOM_PLANE)
    picture[np.isin(renderer.render()[..., 0], [-1, *planes])] = 244  # neither sky nor floor
    renderer.close()
    return picture


def rendered_frames(out: Path) -> None:
    """Two frames of each kind that the detector learns from."""
    from pomona.skills.perception.fruit import load_fruit
    from pomona.tools.training.dataset import frame_seed
    from pomona.tools.training.options import SceneOptions
    from pomona.tools.training.scene import render_scene

    apple = load_fruit("apple")
    rows = []
    for index in range(2):
        row = []
        for kind in range(4):
            chances = tuple(float(k == kind) for k in range(4))
            options = SceneOptions(kinds=chances)  # type: ignore[arg-type]
            row.append(render_scene(apple, options, frame_seed(1, 10 * kind + index)).colour)
        rows.append(np.hstack(row))
    Image.fromarray(np.vstack(rows)).resize((1280, 480), Image.Resampling.LANCZOS).save(
        out, quality=85
    )


def found_in_a_frame(out: Path) -> None:
    """Draw a held-out frame with the detector's finds, and the finder's belief."""
    from pomona.skills.perception.detection.compact_detector import CompactDetector
    from pomona.skills.perception.fruit import load_fruit
    from pomona.tools.training.dataset import frame_seed
    from pomona.tools.training.options import SceneOptions
    from pomona.tools.training.report import draw
    from pomona.tools.training.scene import render_scene

    apple, options = load_fruit("apple"), SceneOptions(kinds=(1.0, 0.0, 0.0, 0.0))
    assert apple.weights is not None
    frame = render_scene(apple, options, frame_seed(9001, 3))
    fx, fy, cx, cy = options.camera
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    drawn = draw(CompactDetector.load(apple.weights), frame.colour, K, apple)
    Image.fromarray(drawn).save(out, quality=88)


PAGE = "executive/pomona/tools/dashboard/static/"
PICTURES: dict[str, Picture] = {
    "pick.png": Picture(
        run_picture,
        (
            "executive/pomona/executive/recording/picture.py",
            "executive/pomona/executive/palette.py",
        ),
        figures_of_pick,
    ),
    "pick.webp": Picture(
        page_animation,
        tuple(
            PAGE + file
            for file in ("index.html", "style.css", "scene.js", "timeline.js", "pictures.js")
        ),
        figures_of_pick,
    ),
    "lifted.jpg": Picture(lifted_apple, ("drivers/pomona/tools/simulation/layout.py",)),
    "rendered.jpg": Picture(
        rendered_frames,
        ("skills/pomona/tools/training/scene.py", "skills/pomona/tools/training/composition.py"),
    ),
    "detect.jpg": Picture(
        found_in_a_frame,
        tuple(
            f"skills/pomona/skills/perception/detection/{file}"
            for file in (
                "compact_detector.py",
                "close_look.py",
                "places.py",
                "weights_file.py",
                "weights/apple.weights",
            )
        ),
    ),
}


def digest_of(picture: Picture) -> str:
    """Return a digest of the picture's sources. A pattern without files is an error."""
    sum_of_all = hashlib.sha256()
    for pattern in picture.sources:
        found = sorted(ROOT.glob(pattern))
        assert found, f"{pattern}: there is no such file"
        for path in found:
            sum_of_all.update(path.name.encode() + b"\0" + drawn_by(path) + b"\0")
    return sum_of_all.hexdigest()[:16]


def drawn_by(path: Path) -> bytes:
    """Return the part of a file that can change a picture: of Python all but its format, comments, docstrings, imports."""
    content = path.read_bytes()
    if path.suffix != ".py":
        return content
    tree = ast.parse(content)
    for node in ast.walk(tree):
        if isinstance(body := getattr(node, "body", None), list):
            node.body = [each for each in body if not is_silent(each)]  # type: ignore[attr-defined]
    return ast.unparse(tree).encode()


def is_silent(node: ast.AST) -> bool:
    """Return True for an import and for a text that stands alone."""
    return isinstance(node, (ast.Import, ast.ImportFrom)) or (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def ledger() -> dict[str, dict[str, Any]]:
    """Return the entries of the pictures, by name."""
    entries: dict[str, dict[str, Any]] = (
        json.loads(LEDGER.read_text("utf-8")) if LEDGER.is_file() else {}
    )
    return entries


def behind() -> list[str]:
    """Pictures whose sources have changed since they were made."""
    made = ledger()
    return [
        name
        for name, picture in PICTURES.items()
        if made.get(name, {}).get("sources") != digest_of(picture)
    ]


def looks_the_same(one: Path, other: Path) -> bool:
    """Return True if two pictures look alike from afar: every frame, 96 pixels wide, in grey."""
    with Image.open(one) as a, Image.open(other) as b:
        if a.size != b.size or getattr(a, "n_frames", 1) != getattr(b, "n_frames", 1):
            return False
        for frame in range(getattr(a, "n_frames", 1)):
            small = []
            for image in (a, b):
                image.seek(frame)
                size = (96, max(1, 96 * image.height // image.width))
                small.append(
                    np.asarray(image.convert("L").resize(size, Image.Resampling.BOX), np.float64)
                )
            if np.abs(small[0] - small[1]).mean() >= SAME:
                return False
    return True


def make(name: str, entries: dict[str, dict[str, Any]]) -> None:
    """Make one picture, and record it in the ledger."""
    picture, stands = PICTURES[name], IMAGES / name
    with tempfile.TemporaryDirectory() as scratch:
        fresh = Path(scratch) / name
        picture.make(fresh)
        entry: dict[str, Any] = {
            "command": "make figures",
            "commit": commit_here(),
            "sources": digest_of(picture),
        }
        if picture.shows is not None:
            entry["shows"] = picture.shows()
        same = (  # figures that can be read off it are not seen from afar
            stands.is_file()
            and entry.get("shows") == entries.get(name, {}).get("shows")
            and looks_the_same(stands, fresh)
        )
        if not same:
            stands.write_bytes(fresh.read_bytes())
        entries[name] = entry
    sys.stdout.write(f"{stands.relative_to(ROOT)}: {'as it was' if same else 'made anew'}\n")


def main() -> int:
    """Make the requested pictures; with --check return 1 if one is outdated."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"of {', '.join(PICTURES)}; default: those that are behind",
    )
    parser.add_argument("--check", action="store_true", help="make nothing")
    options = parser.parse_args()
    names = options.names or behind()
    if options.check:
        sys.stdout.writelines(
            f"docs/images/{name} is older than its sources: make figures\n" for name in names
        )
        return 1 if names else 0
    entries = ledger()
    for name in names:
        make(name, entries)
        LEDGER.write_text(
            json.dumps(dict(sorted(entries.items())), indent=1, ensure_ascii=False) + "\n", "utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
