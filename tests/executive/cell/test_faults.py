"""A plan of faults turns its switches when it is time, once."""

import pytest

from benchmarks.fault_plan import FaultPlan, PlannedFault
from pomona.executive.cell.device import FaultSwitch


class Lamp(FaultSwitch):
    known_faults = ("dark", "flickers")


def test_faults_begin_at_their_times_and_end_when_they_have_lasted():
    lamp = Lamp()
    plan = FaultPlan([PlannedFault("lamp", "dark", after=1.0, lasts=0.5)], {"lamp": lamp})
    told = {}
    for now in (0.0, 0.9, 1.0, 1.4, 1.5, 3.0):
        plan.step(now)
        told[now] = lamp.fault
    assert told == {0.0: None, 0.9: None, 1.0: "dark", 1.4: "dark", 1.5: None, 3.0: None}


def test_faults_of_a_phase_wait_for_its_first_beginning():
    lamp = Lamp()
    plan = FaultPlan([PlannedFault("lamp", "flickers", after=0.2, phase="lifting")], {"lamp": lamp})
    plan.step(100.0)
    plan.begin("closing", 100.0)
    plan.step(101.0)
    assert lamp.fault is None
    plan.begin("lifting", 101.0)
    plan.step(101.1)
    assert lamp.fault is None
    plan.step(101.2)
    assert lamp.fault == "flickers"
    lamp.clear_fault()
    plan.begin("lifting", 102.0)
    plan.step(110.0)
    assert lamp.fault is None
    assert [(now, fault.kind) for now, fault in plan.injected] == [(101.2, "flickers")]


def test_a_plan_with_a_switch_that_no_device_has_is_refused_with_those_that_there_are():
    with pytest.raises(ValueError, match=r"'lamb' is no switch; take one of \['lamp'\]"):
        FaultPlan([PlannedFault("lamb", "dark")], {"lamp": Lamp()})
