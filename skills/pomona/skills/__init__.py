"""The skills of a picking task: each a pure algorithm beside a thin py_trees behaviour.

The names below are public, and loaded on first use: bases and helpers of further skills.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from pomona.executive.values.public_names import on_first_use
from pomona.skills.compiled_code import keep_apart

if TYPE_CHECKING:
    from pomona.skills.geometry import (
        inverse as inverse,
        rot_x as rot_x,
        rot_z as rot_z,
        transform as transform,
    )
    from pomona.skills.shared.following import (
        MOTION_FAILURES as MOTION_FAILURES,
        MovingSkill as MovingSkill,
    )
    from pomona.skills.shared.frame_trust import require_true_look as require_true_look
    from pomona.skills.shared.grasp_view import fruit_mesh as fruit_mesh, summary as summary
    from pomona.skills.shared.held_fruit import (
        bruising as bruising,
        grip_settings as grip_settings,
        show_grip as show_grip,
    )
    from pomona.skills.shared.live_watch import (
        KnownAround as KnownAround,
        LiveWatch as LiveWatch,
        ask_operator as ask_operator,
        prepare_watch as prepare_watch,
        watched as watched,
    )
    from pomona.skills.shared.looking import (
        LOOKING_FAILURES as LOOKING_FAILURES,
        LookingSkill as LookingSkill,
        find_in_frame as find_in_frame,
    )
    from pomona.skills.shared.planning import usable_field as usable_field
    from pomona.skills.shared.straight_travel import (
        Manner as Manner,
        follow_way as follow_way,
        tool_pose as tool_pose,
        vertical_way as vertical_way,
    )
    from pomona.skills.shared.touch import Touch as Touch
    from pomona.skills.shared.touch_view import record_touches as record_touches
    from pomona.skills.shared.warm_motion import prepare_moving as prepare_moving

PUBLIC = {
    "geometry": "inverse rot_x rot_z transform",
    "shared.following": "MOTION_FAILURES MovingSkill",
    "shared.frame_trust": "require_true_look",
    "shared.grasp_view": "fruit_mesh summary",
    "shared.held_fruit": "bruising grip_settings show_grip",
    "shared.live_watch": "KnownAround LiveWatch ask_operator prepare_watch watched",
    "shared.looking": "LOOKING_FAILURES LookingSkill find_in_frame",
    "shared.straight_travel": "Manner follow_way tool_pose vertical_way",
    "shared.touch": "Touch",
    "shared.touch_view": "record_touches",
    "shared.planning": "usable_field",
    "shared.warm_motion": "prepare_moving",
}
"""Public names by the module that defines them."""

# PyOpenGL chooses its platform once, when anything imports it first. All that is rendered here is off the screen.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
keep_apart(Path(__file__).parent)

if not TYPE_CHECKING:
    __getattr__, __dir__ = on_first_use(__name__, PUBLIC)
