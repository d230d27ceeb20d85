"""Base of the skills that find fruit in a frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from pomona.drivers.errors import FrameUnreadable
from pomona.drivers.interfaces import Arm, Camera, Frame, FruitKinds
from pomona.executive.skill import CellFacts, Failure, Skill, SkillFailure, Work
from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.executive.values.installation import entry_points, install_extra, reinstall
from pomona.executive.values.sections import Problem
from pomona.executive.views import ImageView, Line2, Pinhole
from pomona.skills.motion.robot.model import RobotModel
from pomona.skills.perception.detection.detection import (
    DETECTORS,
    WORKING_WIDTH,
    BoxModelFile,
    DopeFiles,
    Search,
)
from pomona.skills.perception.detection.dope_config import find_entry
from pomona.skills.perception.detection.errors import (
    BadFrame,
    BadPoseConfig,
    BadWeights,
    MissingPackage,
)
from pomona.skills.perception.detection.instances import Instance, find_instances
from pomona.skills.perception.detection.places import width_for
from pomona.skills.perception.detection.weights_file import ENDING
from pomona.skills.perception.fruit import FruitModel, find_weights, load_fruit
from pomona.skills.perception.fruit.catalogue import (
    SHIPPED_WEIGHTS,
    FruitError,
    damage,
    known_fruits,
)

if TYPE_CHECKING:  # engines are loaded where they are used: importing PyTorch takes seconds
    from pomona.skills.perception.detection.compact_detector import CompactDetector

_EDGES = np.array([0, 1, 2, 3, 0, 4, 5, 1, 5, 6, 2, 6, 7, 3, 7, 4])


# words that the port `working_width` takes beside a number
AUTO_WIDTH = "auto"
EVERY_WIDTH = "all"
# numbers that it takes [px]
LEAST_WIDTH = 64
MOST_WIDTH = 4096
_NO_WIDTH = (
    f"{{}} is not a width from {LEAST_WIDTH} to {MOST_WIDTH} px, {AUTO_WIDTH} or {EVERY_WIDTH}"
)
WIDTH_HELP = (
    f"width at which the whole picture is searched, {LEAST_WIDTH} to {MOST_WIDTH} [px]; "
    f"{EVERY_WIDTH}: several widths, up to the picture's own"
)


LOOKING_FAILURES = (
    "NO_FRAME",
    "STALE_FRAME",
    "NOTHING_FOUND",
    "NO_WEIGHTS",
)  # codes of every skill that looks


OLDEST = 0.5  # frames that are older are refused [s]


class LookingSkill(Skill):
    """A skill that finds fruit in the camera's newest frame; it must declare `LOOKING_FAILURES`."""

    devices: ClassVar[tuple[type, ...]] = (Camera,)
    optional_devices: ClassVar[tuple[type, ...]] = (Arm,)
    moves = ()

    def prepare(self) -> None:
        """Load and warm the detector of the fruit to look for; values that only the run gives are loaded at first use.

        Raises:
            BadWeights, BadPoseConfig: a file of the detector is missing or cannot be used.
            MissingPackage: PyTorch runs DOPE's network, and it is not installed.
        """
        name, weights, config, boxes = (
            self.known(port) for port in ("fruit", "weights", "config", "boxes")
        )
        if name is None:
            return
        fruit = load_fruit(name)
        if weights:
            fruit = replace(fruit, weights=_weights_file(weights))
        if boxes:
            plain = BoxModelFile(Path(boxes))
            pose = self.known("pose_from") or plain.pose
            width = boxes_width(self.known("working_width"))
            _own_detector(
                BoxModelFile(plain.model, pose, width), fruit.name, fruit.weights, _sides(fruit)
            )
            return
        if config and weights:
            _own_detector(DopeFiles(Path(weights), Path(config)), fruit.name, None, _sides(fruit))
            return
        if fruit.weights is None:
            raise BadWeights(
                SHIPPED_WEIGHTS / f"{fruit.name}{ENDING}",
                "is missing: restore it, or train the detector",
            )
        _detector(fruit.weights)

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """The fruit must be in the catalogue, sound, with weights; a simulated cell should hold it."""
        if "working_width" in known and _width(known["working_width"]) is None:
            yield Problem("working_width", _NO_WIDTH.format(known["working_width"]))
        name = known.get("fruit")
        if name is None:
            return
        try:
            fruit = load_fruit(name)
        except FruitError as error:
            yield Problem("fruit", str(error))
            return
        if (boxes := known.get("boxes")) and not Path(boxes).is_file():
            yield Problem("boxes", f"there is no file {boxes}")
        if config := known.get("config"):
            try:
                find_entry(Path(config), fruit.name, fruit.dimensions)
            except BadPoseConfig as error:
                yield Problem("config", str(error))
            if boxes:
                yield Problem(
                    "config",
                    f"it goes with DOPE's weights, not with boxes: {boxes}",
                    "wire one of them",
                )
            elif "weights" in known and not known["weights"]:
                yield Problem(
                    "config",
                    f"{config} needs the weights that it configures",
                    "weights: epoch_60.pth",
                )
            if find_spec("torch") is None:
                words = "PyTorch runs DOPE's network, and it is not installed"
                yield Problem("config", words, install_extra("torch"))
        if not (
            boxes and known.get("pose_from") == "depth"
        ):  # with depth alone, no weights are read
            yield from _weights_problems(name, fruit, known.get("weights"))
        kinds = None if cell is None else cell.known(FruitKinds)
        if (
            cell is not None
            and kinds is not None
            and not {fruit.name, Path(name).name} & set(kinds.names)
        ):
            there = ", ".join(kinds.names)
            message = f"there is no {fruit.name} on the table of the cell '{cell.name}', which holds {there}"
            yield Problem("fruit", message, warning=True)

    @classmethod
    def offers(cls, port: str, cell: CellFacts | None) -> tuple[str, ...]:
        """Return the fruit on the cell's table, or all in the catalogue."""
        if port != "fruit":
            return ()
        kinds = None if cell is None else cell.known(FruitKinds)
        return known_fruits() if kinds is None else tuple(kinds.names)

    def fruit_model(self, fruit: str, weights: str = "", needs_weights: bool = True) -> FruitModel:
        """Return the fruit of a name or path; fails with NO_WEIGHTS if it has none and `needs_weights`.

        `weights` is a file, or the name of shipped weights; empty for the fruit's own.
        """
        try:
            model = load_fruit(fruit)
        except FruitError as error:
            raise self.failure("NO_WEIGHTS", str(error), fruit=fruit) from error
        if weights:
            return replace(model, weights=_weights_file(weights))
        if model.weights is None and needs_weights:
            raise self.failure(
                "NO_WEIGHTS",
                f"there are no detector weights for {model.name}: {_training(fruit, model)}",
                fruit=fruit,
            )
        return model

    def newest_frame(self) -> Frame:
        """Return the camera's newest frame, not older than `OLDEST`; fails with NO_FRAME or STALE_FRAME."""
        try:
            frame = self.device(Camera).latest()
        except FrameUnreadable as error:
            raise self.failure("NO_FRAME", error.message) from error
        return require_fresh(self, frame, OLDEST)

    def search_width(
        self, width: object, fruit: FruitModel, frame: Frame, distance: float | None
    ) -> int | None:
        """Return the width at which a frame is searched [px]; None for several, up to the frame's own.

        Args:
            width: value of the port `working_width`.
            distance: expected distance of the fruit [m]; `auto` without one means several widths.

        Raises SkillFailure: BAD_VALUE, since the port's value is none of those that its help names.
        """
        wanted = _width(width)
        if wanted is None:
            data = {"port": "working_width"}
            raise SkillFailure(
                Failure("BAD_VALUE", f"input working_width: {_NO_WIDTH.format(width)}", data)
            )
        if isinstance(wanted, int):
            return wanted
        if wanted == EVERY_WIDTH or distance is None:
            return None
        return width_for(
            distance, float(fruit.dimensions.max()), frame.intrinsics.fx, frame.colour.shape[1]
        )

    def camera_pose(self, frame: Frame) -> Float64:
        """T_base_camera of a frame, shape (4, 4)."""
        if frame.q is None:
            return frame.T_mount_camera
        arm = self.optional_device(Arm)
        if arm is None:
            raise self.failure(
                "NO_FRAME", "the frame was taken from an arm, and the cell has no arm"
            )
        robot = RobotModel.load(arm.description)
        T_base_camera: Float64 = robot.fk(frame.q) @ frame.T_mount_camera
        return T_base_camera

    def find(self, frame: Frame, model: FruitModel, options: Search) -> Work[list[Instance]]:
        """Find every fruit of a frame beside the tick; fails with NO_FRAME or NO_WEIGHTS if these are unusable."""
        try:
            return (yield from self.compute(find_in_frame, frame, model, options))
        except BadFrame as error:
            raise self.failure("NO_FRAME", f"the camera's frame cannot be used: {error}") from error
        except (BadWeights, BadPoseConfig, MissingPackage) as error:
            raise self.failure("NO_WEIGHTS", str(error), fruit=model.name) from error


def boxes_width(width: object) -> int:
    """Return the width [px] for a detector of boxes, which searches at one width: the usual one unless given."""
    wanted = _width(width)
    return wanted if isinstance(wanted, int) else WORKING_WIDTH


def _width(given: object) -> int | str | None:
    """Return the number or word that the port `working_width` was given, also as text; None for another value."""
    if given in (AUTO_WIDTH, EVERY_WIDTH):
        return str(given)
    text = str(given)
    is_number = text.isascii() and text.isdigit() and len(text) <= len(str(MOST_WIDTH))
    return int(text) if is_number and LEAST_WIDTH <= int(text) <= MOST_WIDTH else None


def _weights_file(weights: str) -> Path:
    """Return the file of this path, else the shipped one of this name."""
    return find_weights(Path(), weights) or Path(weights)


def _weights_problems(name: str, fruit: FruitModel, weights: str | None) -> Iterator[Problem]:
    if weights:
        path = _weights_file(weights)
        if not path.is_file():
            yield Problem("weights", f"there is no file {path}")
    elif fruit.weights is None:
        hint = f"train its detector: {_training(name, fruit)}"
        yield Problem("fruit", f"there are no weights to find {fruit.name} by", hint)
    elif problem := damage(fruit.weights):
        yield Problem(
            "fruit", f"the weights {fruit.weights} cannot be read: {problem}", "restore the file"
        )


@lru_cache(maxsize=4)
def _detector(weights: Path) -> CompactDetector:
    from pomona.skills.perception.detection.compact_detector import CompactDetector

    detector = CompactDetector.load(weights)
    detector.warm_up()
    return detector


class FrameDetector(Protocol):
    """A detector that another package gives (entry points `pomona.detectors`)."""

    def find_instances(self, colour: UInt8, K: Float64, depth: Float32 | None) -> list[Instance]:
        """Return the fruit of a frame, by falling score.

        Args:
            colour: (h, w, 3) uint8 RGB.
            K: camera matrix (3, 3) [px].
            depth: (h, w) [m], registered to the colour; None without a depth camera.
        """


@lru_cache(maxsize=4)
def _own_detector(
    files: BoxModelFile | DopeFiles,
    fruit: str,
    weights: Path | None,
    dimensions: tuple[float, float, float],
) -> FrameDetector:
    """Return the user's own detector of a fruit, as the package loads it that reads its files."""
    name, file = ("dope", files.weights) if isinstance(files, DopeFiles) else ("boxes", files.model)
    for point in entry_points(group=DETECTORS, name=name):
        try:
            load = point.load()
        except ImportError as error:
            raise MissingPackage("torch", f"runs the network {file}") from error
        detector: FrameDetector = load(files, fruit, weights, dimensions)
        return detector
    raise BadWeights(file, f"no installed package reads such detectors: {reinstall('pomona')}")


def _sides(fruit: FruitModel) -> tuple[float, float, float]:
    x, y, z = fruit.dimensions.tolist()
    return x, y, z


def find_in_frame(frame: Frame, fruit: FruitModel, options: Search) -> list[Instance]:
    """Return every fruit of a frame; its detector is loaded once in a process.

    Raises:
        BadFrame: the frame's picture has another shape or type.
        BadWeights, BadPoseConfig: the detector's files cannot be used.
        MissingPackage: PyTorch runs DOPE's network, and it is not installed.
    """
    colour = frame.colour
    K = frame.intrinsics.K
    if isinstance(options, BoxModelFile | DopeFiles):
        own = _own_detector(options, fruit.name, fruit.weights, _sides(fruit))
        return own.find_instances(colour, K, frame.depth)
    assert fruit.weights is not None
    return find_instances(
        _detector(fruit.weights).looking(replace(options, kind=fruit.name)), colour, K, fruit
    )


def picture(
    frame: Frame, T_base_camera: Float64, instances: list[Instance], chosen: int | str, score: float
) -> ImageView:
    """Return the frame with the cuboids that were found; `chosen` is the target's index, or why there is none."""
    lines = []
    for k, instance in enumerate(instances):
        if instance.score < score:
            continue
        style = "found" if k == chosen else "muted"
        lines.append(
            Line2(instance.keypoints[_EDGES], f"fruit {k}, score {instance.score:.2f}", style)
        )
    centres = np.array([i.keypoints[8] for i in instances if i.score >= score]).reshape(-1, 2)
    target = f", target {chosen}" if isinstance(chosen, int) else chosen and f", {chosen}"
    optics = frame.intrinsics
    pinhole = Pinhole(optics.fx, optics.fy, optics.cx, optics.cy, T_base_camera)
    return ImageView(
        frame.colour, tuple(lines), centres, f"{len(lines)} found{target}", frame.depth, pinhole
    )


def _training(fruit: str, model: FruitModel) -> str:
    """Return the command that makes weights for a fruit of this name or path, and the port that takes them."""
    weights = f"{model.name}{ENDING}"
    return f"pomona train detect --fruit {fruit} --out {weights}, then wire 'weights: {weights}' beside 'fruit'"


def require_fresh(skill: Skill, frame: Frame | None, oldest: float) -> Frame:
    """Return a frame that is not older than `oldest` [s]; fails with NO_FRAME or STALE_FRAME."""
    if frame is None:
        raise skill.failure("NO_FRAME", "the camera has not delivered a frame yet")
    age = skill.clock.now() - frame.stamp
    if age > oldest:
        words = f"the newest frame is {age:.2f} s old, {oldest:g} s are allowed"
        raise skill.failure("STALE_FRAME", words, age_s=age)
    return frame
