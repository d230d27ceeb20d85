"""Before a run: the picks of earlier runs against the limits in the cell file, and self-calibration.

Nothing is connected yet, and no other run is using the cell.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.executive.cell.cell_file import CellFile
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder
from pomona.tools.caliper.cell_section import CaliperOptions, caliper_of, hand_eye_of

if TYPE_CHECKING:
    from pomona.executive.cell.registration import Settings
    from pomona.tools.caliper.findings import CameraFinding
    from pomona.tools.caliper.records import Picks

logger = logging.getLogger(__name__)

WHAT_TO_DO = "`pomona calibrate from-picks` proposes a better pose"


def admit(order: RunOrder, cell: CellFile) -> RunOrder:
    """Return the order, slower where the camera is off by more than the cell file's `slow`.

    A cell without `driver: caliper` is not looked at. Until picks have shown that fruit lie where the camera sees
    them, and with a pose that `self_calibration: apply` has just corrected, runs go at `first_speed`.

    Raises UsageError: the camera is off by more than `refuse`, or than `ask` and the order is not `cleared`.
    """
    said, root = caliper_of(cell), order.past or order.record
    if said is None:
        return order
    from pomona.tools.caliper.estimate import estimate
    from pomona.tools.caliper.findings import find_error, is_proven
    from pomona.tools.caliper.records import Picks

    limits: CaliperOptions = said.values
    read = Picks() if root is None else picks_before(root, cell)
    found = estimate(read.picks) if read.picks else None
    if found is None or not is_proven(found):
        if limits.first_speed < order.speed:
            words = "%s: fewer than three picks show fruit within 8 mm: the run goes at %.0f %% (`first_speed`)."
            logger.warning(words, cell.name, 1e2 * limits.first_speed)
        order = replace(order, speed=min(order.speed, limits.first_speed))
    finding = None if found is None else find_error(found)
    return (
        order
        if finding is None or not finding.is_off
        else _answer(order, cell, said, read, finding)
    )


def _answer(
    order: RunOrder,
    cell: CellFile,
    said: Settings[CaliperOptions],
    read: Picks,
    finding: CameraFinding,
) -> RunOrder:
    limits, far = said.values, finding.far
    if limits.self_calibration != "off":
        correction = _correct(read, cell, limits)
        if correction is not None:
            logger.warning("%s: %s %s", cell.name, finding.sentence, correction)
            return replace(order, speed=min(order.speed, limits.first_speed))
    if far >= limits.refuse:
        raise UsageError(str(said.error(f"{finding.sentence} No run begins", "refuse", WHAT_TO_DO)))
    if far >= limits.ask and not order.cleared:
        words = f"{finding.sentence} Look at the camera's mount; `--cleared` confirms that it was looked at"
        raise UsageError(str(said.error(words, "ask", WHAT_TO_DO)))
    if far >= limits.slow:
        speed = min(order.speed, limits.slow_speed)
        logger.warning("%s: %s The run goes at %.0f %%.", cell.name, finding.sentence, 1e2 * speed)
        return replace(order, speed=speed)
    if far >= limits.warn:
        logger.warning("%s: %s %s.", cell.name, finding.sentence, WHAT_TO_DO)
    return order


def picks_before(root: Path, cell: CellFile) -> Picks:
    """Return the picks of earlier runs with a cell as it is now; of another pose of the camera there are none."""
    import numpy as np

    from pomona.executive.recording.folder import hash_of, in_order, records_in
    from pomona.tools.caliper.explain import add_back
    from pomona.tools.caliper.records import SAME_POSE, Picks
    from pomona.tools.caliper.self_calibration import read_pose

    own = cell.files.get(cell.path.name, "")
    texts = [text for name, text in cell.files.items() if name != cell.path.name]
    read = Picks.of_run("this run", cell.name, hash_of(own, *texts), ())
    records = {path.parent for path in records_in(root)}
    for _ in add_back(read, in_order(records, lambda record: record.name)):
        pass
    read.runs.remove("this run")
    hand_eye = hand_eye_of(cell)
    if hand_eye is not None and read.picks:
        _, T = read_pose(hand_eye)
        if np.abs(T - read.picks[0].T_mount_camera).max() > SAME_POSE:
            return Picks.of_run("this run", cell.name, "", ())
    return read


def _correct(read: Picks, cell: CellFile, limits: CaliperOptions) -> str | None:
    """Return a sentence about the correction that was applied; None where nothing changed."""
    from pomona.tools.caliper.command_from_picks import propose
    from pomona.tools.caliper.self_calibration import apply, before_of

    hand_eye = hand_eye_of(cell)
    try:
        content: dict[str, Any] = propose(read)[0]
        kept = content["kept_apart"]
        left = (
            f"picks kept apart: {kept['before_mm']:.1f} mm before, {kept['after_mm']:.1f} mm after"
        )
        if limits.self_calibration == "propose":
            logger.warning("%s: another pose is proposed (%s): %s.", cell.name, left, WHAT_TO_DO)
            return None
        if hand_eye is None:
            raise UsageError("no camera of the cell has its pose in a file of its own (`hand_eye`)")
        apply(hand_eye, content, limits.most, limits.most_turned)
    except UsageError as error:
        reason = str(error).partition("\n")[0]  # `from-picks` lists each unused pick
        logger.warning("%s: the camera's pose is left as it is: %s", cell.name, reason)
        return None
    words = f"{hand_eye} has another pose now ({left}); this run goes at {1e2 * limits.first_speed:.0f} %."
    return f"{words} `pomona calibrate undo-picks {hand_eye}` takes it back ({before_of(hand_eye).name})."
