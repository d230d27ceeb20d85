"""Picks of simulated cells whose camera is not where the cell file has it; touches, forces and truth of each pick.

    python -m benchmarks.caliper_cells OUT.jsonl [--cells 4] [--picks 30] [--shift 25] [--turn 3] [--depth 0.03]

Each cell draws one error of the camera's pose, uniform up to ± shift along and ± turn about each of its axes, and one
of the depth's scale. Its picks draw the fruit and the place. Each pick is one try: one look and one attempt. A line of
OUT is one pick. At the end the errors that are left after the picks of each cell are printed; `--picks 0` prints them
for the lines that are in OUT already.

With `--apply` the camera's pose is corrected between picks, as a cell with `self_calibration: apply` does it, and the
arm goes at the first speed until picks have shown that fruit lie where the camera sees them.
"""

from __future__ import annotations

import argparse
import contextlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pomona.drivers.interfaces import Frame
from pomona.executive.encode import plain
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, NodeChanged, Published
from pomona.executive.running.runner import Runner
from pomona.executive.values.arrays import Float64
from pomona.tools.caliper.command_from_picks import propose
from pomona.tools.caliper.estimate import estimate
from pomona.tools.caliper.findings import find_error, is_proven
from pomona.tools.caliper.pick import UnusableTouches, pick_from
from pomona.tools.caliper.records import Picks
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
            depth = None if frame.depth is None else np.ascontiguousarray(frame.depth * self._scale, np.float32)
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
        camera._mount.T_mount_camera = stated = camera._mount.T_mount_camera @ np.linalg.inv(pose_of(error))
        camera._newest = replace(camera._newest, T_mount_camera=stated)  # the first look may use the frame of the start


class TrueTouches:
    """True forces of the pads, and the fruit's true skin between them, in each step with a touch."""

    def __init__(self, world: Any) -> None:
        self.steps: list[Float64] = []
        self._world, self._address = world, world.model.jnt_qposadr[world.model.joint("fruit_0").id]
        self._pads = [world.sensor(f"wrench_{pad}") for pad in PADS]
        self._joints = [world.model.joint(name).qposadr[0] for name in ("finger_left", "finger_right")]

    def step(self) -> None:
        """Note one step in which a pad touches."""
        forces = [float(np.linalg.norm(view[:3])) for view in self._pads]
        if max(forces) > 0.0 and len(self.steps) < 4000:
            state = self._world.state
            width = 0.035 + float(state.qpos[self._joints].sum())
            tcp = state.site("tcp")
            pose = state.qpos[self._address : self._address + 7]
            self.steps.append(np.array([self._world.clock.now(), width, *forces, *tcp.xpos, *tcp.xmat, *pose]))

    def at(self, stamp: float) -> dict[str, Any]:
        """Return forces of both pads and the fruit's skin along the fingers, as they truly were at a touch."""
        from scipy.spatial.transform import Rotation

        row = min(self.steps, key=lambda row: abs(row[0] - stamp))
        R = row[7:16].reshape(3, 3)
        turned = Rotation.from_quat(np.roll(row[19:23], -1)).as_matrix()
        points = _filled(self._world.scene.shapes[0]) @ turned.T + row[16:19]
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


def pick(
    cell: str, seed: int, settings: dict[str, str], error: Float64, speed: float, tree: str = "pick_apple"
) -> dict[str, Any]:
    """Run one pick and return its touches, its largest forces and its truth."""
    touches: list[Any] = []
    looks: list[Any] = []
    seen: list[Forces] = []
    felt: list[TrueTouches] = []

    def ready(runner: Runner) -> None:
        devices: Any = runner._cell.devices
        misplace(devices["camera"], error)
        world = devices["world"]
        world = getattr(world, "_world", world)
        seen.append(Forces(world))
        world.after_step.append(seen[0].step)
        felt.append(TrueTouches(world))
        world.after_step.append(felt[0].step)

    def on_event(event: Event) -> None:
        if isinstance(event, NodeChanged) and event.status == "RUNNING" and seen:
            seen[0].node = event.path.rsplit("/", 1)[-1].split("#")[0]
        if isinstance(event, Published) and event.topic == "touches":
            touches.append(plain(event.value))
        if isinstance(event, Published) and event.topic == "doubted_look":
            looks.append(plain(event.value))

    order = RunOrder(find_tree(tree), find_cell(cell), seed=seed, settings=settings, cleared=True, speed=speed)
    try:
        result = execute(order, [on_event], on_ready=ready).result
    except UsageError as refused:
        return {"refused": str(refused)}
    truth = result.truth or {}
    (forces,) = seen
    return {
        "outcome": result.outcome,
        "reason": "" if result.reason is None else result.reason.code,
        "touches": touches,
        "looks": looks,
        "felt": [
            {side: felt[0].at(value[side]["stamp"]) for side in ("left", "right") if value[side] and felt[0].steps}
            for value in touches
        ],
        "pad_n": forces.pad,
        "pads_n": forces.pads,
        "other_n": forces.other,
        "on": forces.on,
        "during": forces.during,
        "time_s": result.time,
        "truth": {key: truth.get(key) for key in ("lifted", "drops", "dimensions_m", "T_base_fruit_at_look")},
    }


FIRST_SPEED = 0.15  # of the arm until picks have shown where fruit lie, as in `driver: caliper`


class Corrected:
    """A cell whose camera is corrected between its runs, as `pomona.tools.caliper.admission` does it."""

    def __init__(self, error: Float64) -> None:
        self.error, self.speed = error, FIRST_SPEED
        self._touches: list[tuple[str, Any]] = []

    def take(self, row: dict[str, Any]) -> str:
        """Take the record of a run; return the correction, or the reason why there is none."""
        from scipy.spatial.transform import Rotation

        values = [*row.get("looks", ()), *row.get("touches", ())]
        self._touches += [(f"pick {len(self._touches) + i}", value) for i, value in enumerate(values)]
        read = Picks.of_run("run", "sim", "", self._touches)
        if not read.picks:
            return ""
        found = estimate(read.picks)
        finding = find_error(found)
        self.speed = 1.0 if not finding.is_off and is_proven(found) else FIRST_SPEED
        if not finding.is_off:
            return finding.sentence
        try:
            content, lines = propose(read)
        except UsageError as none:
            return str(none)
        before, after = (np.array(content[key]) for key in ("T_mount_camera_before", "T_mount_camera"))
        T = np.linalg.inv(np.linalg.inv(before) @ after) @ pose_of(self.error)
        self.error = np.array([*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_rotvec(), *self.error[6:]])
        self._touches = []
        return f"applied: {lines[0]}"


def drawn(rng: np.random.Generator, shift: float, turn: float, depth: float) -> Float64:
    """Draw the error of a cell: t [m], ω [rad], κ and z, uniform."""
    return rng.uniform(-1.0, 1.0, 8) * [*[shift] * 3, *[turn] * 3, depth, 0.0]


def main() -> None:
    """Run the picks and judge them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--cell", default="sim")
    parser.add_argument("--cells", type=int, default=4)
    parser.add_argument("--picks", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--shift", type=float, default=25.0, help="largest, along each axis of the camera [mm]")
    parser.add_argument("--turn", type=float, default=3.0, help="largest, about each axis of the camera [°]")
    parser.add_argument("--depth", type=float, default=0.03, help="largest relative error of the depth's scale")
    parser.add_argument("--speed", type=float, default=1.0, help="of the arm, relative to the commanded one")
    parser.add_argument("--attempts", type=int, default=8)
    parser.add_argument("--looks", default="1", help="of a pick")
    parser.add_argument("--apply", action="store_true", help="correct the camera's pose between picks")
    parser.add_argument("--along-fingers", type=float, help="no drawn error: so far across the picture [mm]")
    options = parser.parse_args()
    with options.out.open("a", encoding="utf-8") as out:
        for number in range(options.cells):
            rng = np.random.default_rng([options.seed, number])
            error = drawn(rng, 1e-3 * options.shift, float(np.radians(options.turn)), options.depth)
            if options.along_fingers is not None:
                error = np.array([1e-3 * options.along_fingers * (-1) ** number, *[0.0] * 7])
            cell = Corrected(error)
            for _ in range(options.picks):
                fruit = {"fruit": f"apple_{rng.integers(1, 6)}", "place": str(rng.integers(1, 6))}
                once = {"attempts": str(options.attempts), "looks": options.looks}
                speed = min(options.speed, cell.speed) if options.apply else options.speed
                row = pick(options.cell, int(rng.integers(1_000_000)), {**fruit, **once}, cell.error, speed)
                row |= {"cell": number, "speed": speed, "error": cell.error.tolist(), **fruit}
                if options.apply:
                    row |= {"applied": cell.take(row), "left": cell.error.tolist()}
                out.write(json.dumps(row) + "\n")
                out.flush()
    rows = [json.loads(line) for line in options.out.read_text(encoding="utf-8").splitlines()]
    print("\n".join(judge(rows)))


def judge(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a line for each cell: what its picks leave of its error, and the largest force."""
    for number in sorted({row["cell"] for row in rows}):
        own = [row for row in rows if row["cell"] == number and "refused" not in row]
        error, picks, widths = np.array(own[0]["error"]), [], []
        for k, row in enumerate(own):
            for touches, felt in zip(row["touches"], row["felt"], strict=True):
                with contextlib.suppress(UnusableTouches):
                    picks.append(pick_from(touches, f"pick {k}"))
                    widths.append(sum(felt[min(felt, key=lambda side: touches[side]["width"])]["skin"]))
        force = max(max(row["pad_n"], row["other_n"]) for row in own)
        if "left" in own[-1]:
            yield _corrected(number, own, force)
            continue
        words = f"cell {number}: {len(own)} tries, {len(picks)} usable picks, largest force {force:.1f} N"
        if picks:
            found = estimate(picks)
            before, left = (_off(found.centre, rest) for rest in (error, error - found.error))
            held = int((np.abs((error - found.error)[:7]) < 1.645 * found.std[:7]).sum())
            fused = [fused_width(pick, found)[0] - width for pick, width in zip(picks, widths, strict=True)]
            alone = [pick.across - width for pick, width in zip(picks, widths, strict=True)]
            words += f"; off by {before} before, {left} after; {held} of 7 intervals hold; width"
            words += (
                f" {1e3 * np.median(np.abs(alone)):.2f} mm by the camera, {1e3 * np.median(np.abs(fused)):.2f} fused"
            )
        yield words


BEFORE = np.array([0.0, 0.0, 0.55])  # a place on the table in the camera's frame [m]


def _corrected(number: int, own: list[dict[str, Any]], force: float) -> str:
    """Return a line about a cell that was corrected between its runs."""
    begun, left = (_off(BEFORE, np.array(error)) for error in (own[0]["error"], own[-1]["left"]))
    ends = ", ".join(row["reason"] or row["outcome"] for row in own)
    steps = sum(row["applied"].startswith("applied") for row in own)
    return (
        f"cell {number}: {begun} at first, {left} after {len(own)} runs and {steps} corrections, {force:.1f} N ({ends})"
    )


def _off(centre: Float64, error: Float64) -> str:
    place = error[:3] + np.cross(error[3:6], centre) + error[6] * centre
    turn = np.degrees(np.linalg.norm(error[3:6]))
    return f"{1e3 * np.linalg.norm(place):.1f} mm {turn:.2f}° {1e2 * error[6]:+.2f} %"


if __name__ == "__main__":
    main()
