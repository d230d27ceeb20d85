"""Cells whose camera is not where the cell file has it: words, corrections, touches, forces and truth of each run.

    python -m benchmarks.caliper_cells OUT [--cells 5] [--runs 12] [--fault drawn | good | shift | tilt | roll]
    python -m benchmarks.caliper_cells OUT --cell conveyor --tree pick_from_conveyor --set most=6
    python -m benchmarks.caliper_cells OUT --cell FOLDER/emulated.yaml --tree pick_apple_plain --set force="40 N"

Each cell draws one error of the camera's pose and of its depth's scale, and keeps the records of its runs in a folder
of OUT. A cell of the package `simulation` gets a section `driver: caliper` and a pose file, so that the answers before
each run are those of the admission; of other cells the camera itself is misplaced. After each run, the words of the
terminal are noted, and those of `pomona explain`. A line of OUT/rows.jsonl is one run. At the end each cell has a line
with the error that is left; `--runs 0` prints it for the rows in OUT.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pomona.devices.emulators.connect import camera_site
from pomona.drivers.interfaces import Frame
from pomona.executive.encode import plain
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, NodeChanged, Published, RunStarted
from pomona.executive.running.runner import Runner
from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.estimate import estimate
from pomona.tools.caliper.explain import explain
from pomona.tools.caliper.findings import find_error
from pomona.tools.caliper.pick import Pick, UnusableTouches, pick_from
from pomona.tools.caliper.run_view import CameraWords
from pomona.tools.caliper.sizes import fused_width
from pomona.tools.simulation.layout import PADS


class Misplaced:
    """Stands in for the camera's `FrameChanger`: each frame has the wrong pose and depth of the cell file."""

    def __init__(self, error: Float64) -> None:
        """Take the error (t, ω, κ, z) of `pomona.tools.caliper.estimate`; z is not the camera's."""
        self._stated = np.asarray(np.linalg.inv(pose_of(error)), np.float64)
        self._scale = np.float32(1.0 / (1.0 + error[6]))
        self._newest: dict[tuple[int, ...], tuple[Frame, Frame]] = {}

    def delivered(self, frame: Frame | None) -> Frame | None:
        """Return the frame that the camera delivers in place of this one."""
        if frame is None:
            return None
        newest = self._newest.get(frame.colour.shape)
        if newest is None or newest[0] is not frame:
            depth = (
                None
                if frame.depth is None
                else np.ascontiguousarray(frame.depth * self._scale, np.float32)
            )
            wrong = replace(frame, T_mount_camera=frame.T_mount_camera @ self._stated, depth=depth)
            newest = self._newest[frame.colour.shape] = frame, wrong
        return newest[1]


def pose_of(error: Float64) -> Float64:
    """Return the camera's true pose in its stated frame, shape (4, 4)."""
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(error[3:6]).as_matrix(), error[:3]
    return T


def misplace(camera: Any, error: Float64) -> None:
    """Give a simulated or emulated camera the pose (and the simulated one the depth) of a wrong cell file."""
    if hasattr(camera, "_changer"):
        camera._changer = Misplaced(error)
    else:
        camera._mount.T_mount_camera = stated = camera._mount.T_mount_camera @ np.linalg.inv(
            pose_of(error)
        )
        camera._newest = replace(
            camera._newest, T_mount_camera=stated
        )  # the first look may use the frame of the start


class TrueTouches:
    """True forces of the pads, and the fruit's true skin between them, in each step with a touch."""

    def __init__(self, world: Any) -> None:
        self.steps: list[Float64] = []
        self._world, names = world, [world.model.joint(i).name for i in range(world.model.njnt)]
        self._fruits = [
            int(world.model.joint(n).qposadr[0]) for n in names if n.startswith("fruit_")
        ]
        self._pads = [world.sensor(f"wrench_{pad}") for pad in PADS]
        self._joints = [
            world.model.joint(name).qposadr[0] for name in ("finger_left", "finger_right")
        ]

    def step(self) -> None:
        """Note one step in which a pad touches."""
        forces = [float(np.linalg.norm(view[:3])) for view in self._pads]
        if max(forces) > 0.0 and len(self.steps) < 40_000:
            state = self._world.state
            width = 0.035 + float(state.qpos[self._joints].sum())
            tcp = state.site("tcp")
            poses = [state.qpos[at : at + 7] for at in self._fruits]
            near = int(np.argmin([np.linalg.norm(pose[:3] - tcp.xpos) for pose in poses]))
            row = self._world.clock.now(), width, *forces, *tcp.xpos, *tcp.xmat, *poses[near], near
            self.steps.append(np.array(row))

    def at(self, stamp: float) -> dict[str, Any]:
        """Return forces of both pads and the fruit's skin along the fingers, as they truly were at a touch."""
        from scipy.spatial.transform import Rotation

        row = min(self.steps, key=lambda row: abs(row[0] - stamp))
        R = row[7:16].reshape(3, 3)
        turned = Rotation.from_quat(np.roll(row[19:23], -1)).as_matrix()
        made = self._world.scene if hasattr(self._world, "scene") else self._world.built
        points = _filled(made.shapes[int(row[23])]) @ turned.T + row[16:19]
        own = (points - row[4:7]) @ R
        return {"step": row[:4].tolist(), "skin": [float(own[:, 1].max()), float(-own[:, 1].min())]}


def _filled(shape: Any) -> Float64:
    """Return points on the faces of a fruit, 1 mm apart and less, shape (n, 3) [m]."""
    rng = np.random.default_rng(0)
    corners = shape.vertices[shape.faces[rng.integers(len(shape.faces), size=60_000)]]
    weights = rng.dirichlet(np.ones(3), size=len(corners))
    return np.vstack([shape.vertices, np.einsum("nk,nkd->nd", weights, corners)])


class Forces:
    """Largest forces on the pads, and between the robot and anything else, in any step of the world [N]."""

    def __init__(self, world: Any) -> None:
        self.pad, self.pads, self.other, self.on, self.during = 0.0, 0.0, 0.0, "", ""
        self.node = ""
        self._wrenches = [world.sensor(f"wrench_{pad}") for pad in PADS]
        names = [world.model.sensor(i).name for i in range(world.model.nsensor)]
        self._others = {
            name.removeprefix("robot_"): world.sensor(name)
            for name in names
            if name.startswith("robot_") and name != "robot_robot"
        }

    def step(self) -> None:
        """Note one step."""
        pads = [float(np.linalg.norm(view[:3])) for view in self._wrenches]
        if max(pads) > self.pad:
            self.pad, self.during = max(pads), self.node
        self.pads = max(self.pads, sum(pads))
        for name, view in self._others.items():
            force = float(np.linalg.norm(view[1:4])) if view[0] > 0.0 else 0.0
            if force > self.other:
                self.other, self.on, self.during = force, name, self.node


class DrawnCell:
    """A cell with a wrong camera, and the records of its runs."""

    def __init__(self, folder: Path, options: argparse.Namespace, number: int) -> None:
        self.rng = np.random.default_rng([options.seed, number])
        self.drawn, self.number = FAULTS[options.fault](self.rng, options), number
        self._options, self._runs, self._pose = options, folder / "runs", folder / "hand_eye.json"
        self._runs.mkdir(parents=True, exist_ok=True)
        self._path = find_cell(options.cell)
        text, trees = self._path.read_text("utf-8"), self._path.parents[1]
        self._has_file = "driver: sim-camera\n" in text
        if not self._has_file:
            return
        self._true = camera_site(trees / "robots" / "sia5f_wsg32.xml")
        stated = self._true @ np.linalg.inv(pose_of(self.drawn))
        self._pose.write_text(json.dumps({"T_mount_camera": stated.tolist()}), "utf-8")
        for name in ("shared/", "sim.yaml"):
            text = text.replace(f"include: {name}", f"include: {trees}/cells/{name}")
        text = text.replace("../", f"{trees}/")
        text = text.replace(
            "driver: sim-camera\n", "driver: sim-camera\n    hand_eye: hand_eye.json\n"
        )
        bounds = "ask: 100 mm, refuse: 100 mm"  # of the draw, not of a careful user
        speeds = (
            "first_speed: 1, slow_speed: 1, " if "conveyor" in options.cell else ""
        )  # a belt needs all of it
        section = f"caliper: {{driver: caliper, {speeds}{bounds}}}"
        self._path = folder / "cell.yaml"
        self._path.write_text(f"{text}  {section}\n", "utf-8")

    @property
    def error(self) -> Float64:
        """The error as it is now, corrections included, shape (8,)."""
        from scipy.spatial.transform import Rotation

        if not self._has_file:
            return self.drawn
        T = np.linalg.inv(json.loads(self._pose.read_text("utf-8"))["T_mount_camera"]) @ self._true
        return np.array([*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_rotvec(), *self.drawn[6:]])

    def run(self, settings: dict[str, str]) -> dict[str, Any]:
        """Run one task; return its words, its touches, its largest forces and its truth."""
        touches: list[Any] = []
        seen: list[Forces] = []
        felt: list[TrueTouches] = []
        words, computed = CameraWords(self._runs), [0.0]
        wrong = np.array([*[0.0] * 6, *self.drawn[6:]]) if self._has_file else self.drawn
        speeds: list[float] = []
        failed: list[str] = []

        def ready(runner: Runner) -> None:
            devices: Any = runner._cell.devices
            misplace(devices["camera"], wrong)
            world = devices["world"]
            world = getattr(world, "_world", world)
            seen.append(Forces(world))
            felt.append(TrueTouches(world))
            world.after_step += [seen[0].step, felt[0].step]

        def on_event(event: Event) -> None:
            if isinstance(event, NodeChanged) and event.status == "RUNNING" and seen:
                seen[0].node = event.path.rsplit("/", 1)[-1].split("#")[0]
            if (
                isinstance(event, NodeChanged)
                and event.status == "FAILURE"
                and event.reason is not None
            ):
                failed.append(f"{event.path}: {event.reason.code}: {event.reason.message}")
            begun = time.thread_time()
            if isinstance(event, RunStarted):
                words.begin(event)
                speeds.append(float(getattr(event, "speed", 1.0) or 1.0))
            if isinstance(event, Published) and event.topic in ("touches", "doubted_look"):
                words.take(event.t, event.value)
                computed[0] += time.thread_time() - begun
            if isinstance(event, Published) and event.topic == "touches":
                touches.append(plain(event.value))

        seed, before = int(self.rng.integers(1_000_000)), self.error.tolist()
        order = RunOrder(
            find_tree(self._options.tree),
            self._path,
            seed=seed,
            settings=settings,
            cleared=True,
            record=self._runs,
        )
        try:
            executed = execute(order, [on_event], on_ready=ready)
        except UsageError as refused:
            return {"cell": self.number, "refused": str(refused), "error": before}
        words.wait(10.0)
        words.close()
        result = executed.result
        truth = result.truth or {}
        (forces,) = seen
        return {
            "cell": self.number,
            "error": self.error.tolist(),  # of this run: an admission corrects before it
            "was": before,
            "speed": speeds,
            "outcome": result.outcome,
            "reason": ""
            if result.reason is None
            else f"{result.reason.code}: {result.reason.message}",
            "failed": failed,
            "words": words.ready(),
            "explain": "" if executed.record is None else explain(executed.record),
            "touches": touches,
            "felt": [
                {
                    side: felt[0].at(value[side]["stamp"])
                    for side in ("left", "right")
                    if value[side] and felt[0].steps
                }
                for value in touches
            ],
            "pad_n": forces.pad,
            "pads_n": forces.pads,
            "other_n": forces.other,
            "on": forces.on,
            "during": forces.during,
            "time_s": result.time,
            "listener_ms": 1e3 * computed[0],
            "truth": {
                key: truth.get(key)
                for key in ("lifted", "drops", "dimensions_m", "put_away", "offered")
            },
            "settings": settings,
        }


def _drawn(rng: np.random.Generator, options: argparse.Namespace) -> Float64:
    """Draw the error of a cell: t [m], ω [rad], κ and z, uniform."""
    shift, turn = 1e-3 * options.shift, float(np.radians(options.turn))
    most: Float64 = np.array([*[shift] * 3, *[turn] * 3, float(options.depth), 0.0])
    return rng.uniform(-1.0, 1.0, 8) * most


def _good(_rng: np.random.Generator, _options: argparse.Namespace) -> Float64:
    return np.zeros(8)


def _shift(rng: np.random.Generator, _options: argparse.Namespace) -> Float64:
    """5 mm in the picture."""
    return np.array([*(5e-3 * _unit(rng)), *[0.0] * 6])


def _tilt(rng: np.random.Generator, _options: argparse.Namespace) -> Float64:
    """1° about a line in the picture."""
    return np.array([*[0.0] * 3, *(np.radians(1.0) * _unit(rng)), *[0.0] * 3])


def _roll(rng: np.random.Generator, _options: argparse.Namespace) -> Float64:
    """1° about the view."""
    return np.array([*[0.0] * 5, np.radians(1.0) * rng.choice([-1.0, 1.0]), *[0.0] * 2])


def _unit(rng: np.random.Generator) -> Float64:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


FAULTS = {"drawn": _drawn, "good": _good, "shift": _shift, "tilt": _tilt, "roll": _roll}


def main() -> None:
    """Make the runs and judge them."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--cell", default="sim")
    parser.add_argument("--tree", default="pick_apple")
    parser.add_argument("--cells", type=int, default=5)
    parser.add_argument("--first", type=int, default=0, help="number of the first cell")
    parser.add_argument("--runs", type=int, default=12, help="of each cell")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fault", choices=tuple(FAULTS), default="drawn")
    parser.add_argument(
        "--shift", type=float, default=25.0, help="largest, along each axis of the camera [mm]"
    )
    parser.add_argument(
        "--turn", type=float, default=3.0, help="largest, about each axis of the camera [°]"
    )
    parser.add_argument(
        "--depth", type=float, default=0.03, help="largest relative error of the depth's scale"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="of the tree or the cell"
    )
    options = parser.parse_args()
    said = dict(item.split("=", 1) for item in options.set)
    options.out.mkdir(parents=True, exist_ok=True)
    with (options.out / "rows.jsonl").open("a", encoding="utf-8") as out:
        for number in range(options.first, options.first + options.cells if options.runs else 0):
            cell = DrawnCell(options.out.resolve() / f"cell_{number}", options, number)
            for _ in range(options.runs):
                fruit = {
                    "fruit": f"apple_{cell.rng.integers(1, 6)}",
                    "place": str(cell.rng.integers(1, 6)),
                }
                row = cell.run({**({} if options.tree == "pick_from_conveyor" else fruit), **said})
                out.write(json.dumps(row) + "\n")
                out.flush()
    rows = [
        json.loads(line)
        for line in (options.out / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    ]
    print("\n".join(judge(rows)))


def judge(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each cell: first notice of its error, error that is left, intervals, widths and forces."""
    for number in sorted({row["cell"] for row in rows}):
        own = [row for row in rows if row["cell"] == number and "refused" not in row]
        refused = sum(row["cell"] == number for row in rows) - len(own)
        if not own:
            yield f"cell {number}: {refused} runs refused"
            continue
        picks: list[Pick] = []
        widths: list[float] = []
        for k, row in enumerate(own):
            if row["error"] != own[-1]["error"]:
                continue  # of a pose that was corrected since
            for touches, felt in zip(row["touches"], row["felt"], strict=True):
                with contextlib.suppress(UnusableTouches):
                    picks.append(pick_from(touches, f"pick {k} {len(picks)}"))
                    sides = min(felt, key=lambda side: touches[side]["width"]) if felt else None
                    widths.append(sum(felt[sides]["skin"]) if sides else np.nan)
        said = [(k + 1, is_off) for k, row in enumerate(own) for is_off, _ in row["words"]]
        noticed = next(
            (f"word {i + 1}, run {k}" for i, (k, is_off) in enumerate(said) if is_off), "never"
        )
        corrections = sum(row["error"] != row["was"] for row in own)
        force = max(max(row["pad_n"], row["other_n"]) for row in own)
        begun, left = (
            _off(BEFORE, np.array(row["error"]))
            for row in (own[0] | {"error": own[0]["was"]}, own[-1])
        )
        picked = sum(row["outcome"] == "success" for row in own)
        yield (
            f"cell {number}: {begun} at first, {left} after {len(own)} runs and {corrections} corrections; "
            f"{picked} succeeded, {refused} refused; {len(said)} words, off: {noticed}, "
            f"{sum(off for _, off in said)} in all; {force:.1f} N"
        )
        if picks:
            error, found = np.array(own[-1]["error"]), estimate(picks)
            held = np.abs((error - found.error)[:7]) < 1.645 * found.std[:7]
            alone = np.array([pick.across for pick in picks]) - widths
            fused = np.array([fused_width(pick, found)[0] for pick in picks]) - widths
            yield (
                f"  {len(picks)} picks of the last pose: {_off(found.centre, error - found.error)} unexplained, "
                f"{''.join('.X'[int(not each)] for each in held)} ('.': the 90 % interval holds), width "
                f"{1e3 * np.nanmedian(np.abs(alone)):.2f} mm by the camera, {1e3 * np.nanmedian(np.abs(fused)):.2f} "
                f"fused; {find_error(found).sentence}"
            )


BEFORE = np.array([0.0, 0.0, 0.55])  # a place on the table in the camera's frame [m]


def _off(centre: Float64, error: Float64) -> str:
    place = error[:3] + np.cross(error[3:6], centre) + error[6] * centre
    turn = np.degrees(np.linalg.norm(error[3:6]))
    return f"{1e3 * np.linalg.norm(place):.1f} mm {turn:.2f}° {1e2 * error[6]:+.2f} %"


if __name__ == "__main__":
    main()
