"""Before a run: the picks of earlier runs against the limits in the cell file.

Nothing is connected yet, and no other run is using the cell.
"""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from pomona.executive.cell.cell_file import CellFile
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder
from pomona.executive.values.plain_text import read_plain_text
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
    them, runs go at `first_speed`.

    Raises UsageError: the camera is off by more than `refuse`, or than `ask` and the order is not `cleared`.
    """
    said = caliper_of(cell)
    root = order.past or order.record
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
            words = (
                "%s: no three picks show fruit within 8 mm along every level line:"
                " the run goes at %.0f %% (`first_speed`)."
            )
            logger.warning(words, cell.name, 1e2 * limits.first_speed)
        order = replace(order, speed=min(order.speed, limits.first_speed))
    finding = None if found is None else find_error(found)
    return order if finding is None or not finding.is_off else _answer(order, cell, said, finding)


def _answer(
    order: RunOrder,
    cell: CellFile,
    said: Settings[CaliperOptions],
    finding: CameraFinding,
) -> RunOrder:
    limits = said.values
    far = finding.far
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

    from pomona.tools.caliper.records import Picks, read_back, records_before, same_pose, values_of

    own = cell.files.get(cell.path.name, "")
    texts = [text for name, text in cell.files.items() if name != cell.path.name]
    none = Picks.of_run("this run", cell.name, values_of(own, *texts), ())
    read = read_back(records_before(root), none)
    hand_eye = hand_eye_of(cell)
    if hand_eye is not None and read.picks:
        T = json.loads(read_plain_text(hand_eye))["T_mount_camera"]
        if not same_pose(np.array(T), read.picks[0].T_mount_camera):
            return Picks.of_run("this run", cell.name, "", ())
    return read
