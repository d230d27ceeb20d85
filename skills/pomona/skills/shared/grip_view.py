"""A grip on the operator's plot: force over time against the minimum grip force."""

from __future__ import annotations

from pomona.executive.skill import Skill
from pomona.executive.views import SeriesView
from pomona.skills.grip.hold import Hold
from pomona.skills.grip.limit_surface import bruising_force

TOPIC = "grip"

NO_BRUISE_BELOW = round(bruising_force(), 1)  # of one finger with the pads that the default contact describes [N]


def watch_grip(skill: Skill, hold: Hold) -> None:
    """Publish the grip; call it each tick. A problem of the grip that the skill declares is a failure."""
    show_grip(skill, hold)
    problem = hold.problem
    if problem is not None and problem.code in skill.failures:
        raise skill.failure(problem.code, problem.message, **problem.data)


def show_grip(skill: Skill, hold: Hold, everything: bool = False) -> None:
    """Publish what the hold recorded since the last view; call it each tick of any node that runs while it holds.

    `everything` publishes all samples, even few (when a node ends).
    """
    if hold.waiting < 0.1 and not (everything and hold.waiting > 0.0):  # seconds of samples in one view
        return
    samples = hold.drain()
    skill.publish(
        TOPIC,
        SeriesView(
            t=samples.t,
            values={
                "grasp force [N]": samples.f_n,
                "reference [N]": samples.f_ref,
                "minimum grip force [N]": samples.f_least,
                "tangential load [N]": samples.f_t,
                "slip speed [m/s]": samples.slip_speed,
                "width [m]": samples.width,
            },
            thresholds={
                "force limit [N]": hold.settings.loop.max_force,
                "no bruise below [N]": NO_BRUISE_BELOW,
            },
        ),
    )
