"""The planner in the process in which it really runs."""

import time
from typing import Any

import numpy as np
import pytest

from pomona.executive.running.compute import Computations
from pomona.skills.motion.collision import CollisionWorld
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.planning.plan import PlanRequest, plan
from pomona.skills.motion.planning.space import PlanningFailed
from pomona.skills.shared.warm_motion import warm_planner
from pomona.tools.mock.arm import ROBOT, SIA5F_LIMITS
from tests.skills.picking_scene import HOME, OBSERVE, ROBOT_MODEL, WORKSPACE

SPACE = ArmSpace(CollisionWorld.build(ROBOT_MODEL, WORKSPACE), 0.1)
INSIDE_TABLE = np.array([-1.36, 1.6, -0.264, -0.234, 0.065, -1.294, 0.048])


@pytest.fixture(scope="module")
def computations():
    running = Computations()
    running.submit("test", warm_planner, (ROBOT,), True).result()
    yield running
    running.close()


def request(goal: np.ndarray, **changes: Any) -> PlanRequest:
    return PlanRequest(SPACE, OBSERVE, goal[None], SIA5F_LIMITS, **changes)


@pytest.mark.slow
def test_the_worker_gives_the_path_that_this_process_would_give(computations):
    there = computations.submit("test", plan, (request(HOME, direct=False),), True).result()
    here = plan(request(HOME, direct=False))
    np.testing.assert_array_equal(there.path.q, here.path.q)


def test_a_failure_comes_out_of_the_worker_with_its_data(computations):
    with pytest.raises(PlanningFailed, match="is free; at the first, ") as failed:
        computations.submit("test", plan, (request(INSIDE_TABLE),), True).result()
    assert failed.value.code == "GOAL_IN_COLLISION"
    assert failed.value.data["link"]


@pytest.mark.slow
def test_a_long_plan_is_gone_at_once_when_it_is_cancelled(computations):
    endless = request(HOME, planner="RRTstar", improve="", direct=False, budget=1e4, patience=1e4)
    computation = computations.submit("test", plan, (endless,), True)
    time.sleep(0.2)
    assert not computation.done()
    began = time.perf_counter()
    computation.cancel()
    assert time.perf_counter() - began < 30.0  # of the 10 000 s that it would take
    assert computations.submit("test", plan, (request(HOME),), True).result().path.duration > 0.0
