"""Five mistakes that a stranger's arm may hold: the claims find each, and say which."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from pomona.drivers import Trajectory
from pomona.drivers.conformance import ARM, ArmBench, Finding, judged
from tests.drivers.conformance.arms import reacher


def forgets_a_stop(arm: Any) -> None:
    """A stop refuses the next motion, and this one goes on."""

    def latched(reason: str) -> None:
        arm._latched = reason

    arm.safe_stop = latched


def believes_what_it_sent(arm: Any) -> None:
    """A pause is a rest as soon as it was told."""
    arm.settled = lambda: arm._motion is None or arm._motion.state.name != "RUNNING"


def looks_at_motions_alone(arm: Any) -> None:
    """Joints are judged while a motion of this run moves them."""
    arm._supervisor.look_at_rest = lambda q: None


def goes_on_when_it_is_acknowledged(arm: Any) -> None:
    """The last motion is begun again."""
    follow, acknowledge = arm.follow, arm.acknowledge
    last: list[Trajectory] = []

    def followed(path: Trajectory) -> Any:
        last[:] = [path]
        return follow(path)

    def acknowledged() -> None:
        acknowledge()
        q = arm.state().q
        path = last[0]
        follow(Trajectory(path.t, path.q - path.q[0] + q, path.qd, path.qdd))

    arm.follow, arm.acknowledge = followed, acknowledged


def presses_on(arm: Any) -> None:
    """An arm that something holds keeps its set-point."""
    halt = arm._halt
    arm._halt = lambda problem: arm._supervisor.has_come_free or halt(problem)


@pytest.mark.parametrize(
    ("mistake", "claim", "words"),
    [
        (forgets_a_stop, "a_stop_is_delivered", "A stop ends each motion"),
        (believes_what_it_sent, "settled_is_measured", "An arm that is settled rests"),
        (looks_at_motions_alone, "an_unordered_motion_is_noticed", "A motion of a resting arm"),
        (
            goes_on_when_it_is_acknowledged,
            "a_problem_stops_the_arm",
            "A problem .* ends each motion",
        ),
        (presses_on, "a_freed_arm_stays", "An arm that something holds .* stays there"),
    ],
)
def test_a_mistake_is_found_and_its_claim_is_named(
    mistake: Callable[[Any], None], claim: str, words: str
) -> None:
    def opened() -> ArmBench:
        bench = reacher()
        mistake(bench.device)
        return bench

    (judge,) = (one for one in ARM.all if one.name == claim)
    with pytest.raises(Finding, match=f"^{words}.*: "):
        judged(opened, judge)
