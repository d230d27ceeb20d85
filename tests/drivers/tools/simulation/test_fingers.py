"""The simulated force fingers read the engine's contacts in the pad's frame, and fail like real ones."""

from collections import deque
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pomona.drivers.errors import DeviceFault, DeviceLost
from pomona.drivers.interfaces import ForceSensor, WrenchSample
from pomona.tools.simulation.fingers import DELAYS, LIES, SimFingers
from pomona.tools.simulation.gl import load_mujoco


def contact_sum(world, pad):
    """Independent sum over the engine's contact list: wrench on the pad, in the pad's frame."""
    mujoco = load_mujoco()
    model, state = world.model, world.state
    geom = model.geom(pad).id
    site = state.site(pad)
    R, origin = site.xmat.reshape(3, 3), site.xpos
    total = np.zeros(6)
    for i in range(state.ncon):
        contact = state.contact[i]
        if geom not in (contact.geom1, contact.geom2):
            continue
        local = np.zeros(6)
        mujoco.mj_contactForce(model, state, i, local)
        frame = contact.frame.reshape(3, 3).T
        sign = 1.0 if contact.geom2 == geom else -1.0
        force, torque = sign * frame @ local[:3], sign * frame @ local[3:]
        total[:3] += R.T @ force
        total[3:] += R.T @ (torque + np.cross(contact.pos - origin, force))
    return total


def test_wrenches_are_the_contacts_in_the_pads_frame(open_cell, probe_of, pick_with):
    cell = open_cell(seed=2, fruit="apple_2", friction="0.8")
    probe = probe_of(cell)
    exact = SimFingers(probe.world, noise=0.0, bias=0.0, force_range=100.0)
    pick_with(probe)
    sample = exact.latest()
    for i, pad in enumerate(("pad_left", "pad_right")):
        assert sample.wrenches[i] == pytest.approx(contact_sum(probe.world, pad), abs=1e-6)
    assert np.all(sample.wrenches[:, 2] < -1.0)  # pressing is negative along z
    # Hanging at rest the pads carry the weight: it pulls them down, along the tool's approach axis.
    weight = probe.world.scene.fruits[0].mass * 9.81
    assert sample.wrenches[:, 0].sum() == pytest.approx(weight, rel=0.02)
    assert abs(sample.wrenches[0, 2] - sample.wrenches[1, 2]) < 0.1
    noisy = np.array([s.wrenches for s in probe.samples[-100:]])
    assert np.abs(noisy.mean(axis=0)[:, :3] - sample.wrenches[:, :3]).max() < 0.2


def test_samples_come_at_500_hz_in_order_to_every_listener(open_cell):
    cell = open_cell()
    fingers = cell.device(ForceSensor)
    first, second = [], []
    subscription = fingers.subscribe(first.append)
    fingers.subscribe(second.append)
    cell.clock.advance(0.1)
    subscription.close()
    subscription.close()
    cell.clock.advance(0.02)
    assert [s.sequence for s in second] == list(range(1, 61))
    assert np.diff([s.stamp for s in second]) == pytest.approx(0.002)
    assert len(first) == 50
    assert fingers.latest() is second[-1]
    assert fingers.rate == 500.0


def test_errors_stay_within_the_real_fingers_accuracy(open_cell):
    cell = open_cell(seed=5)
    samples = []
    cell.device(ForceSensor).subscribe(samples.append)
    cell.clock.advance(2.0)
    forces = np.array([s.wrenches[:, :3] for s in samples])
    assert np.sqrt((forces**2).mean()) < 0.1
    assert np.abs(forces).max() < 0.3
    assert forces.std(axis=0) == pytest.approx(0.04, rel=0.15)


def test_the_range_ends_with_a_flag(open_cell, probe_of, pick_with):
    cell = open_cell(seed=2, fruit="apple_2")
    probe = probe_of(cell)
    narrow = SimFingers(probe.world, noise=0.0, bias=0.0, force_range=2.0)
    pick_with(probe)
    sample = narrow.latest()
    assert sample.saturated == (True, True)
    assert np.abs(sample.wrenches[:, :3]).max() == 2.0


def test_a_lost_stream_is_noticed_within_60_ms(open_cell):
    cell = open_cell()
    fingers = cell.device(ForceSensor)
    samples = []
    fingers.subscribe(samples.append)
    cell.clock.advance(0.05)
    fingers.inject_fault("lost")
    cell.clock.advance(0.04)
    cell.check()
    assert len(samples) == 25
    cell.clock.advance(0.02)
    with pytest.raises(DeviceLost, match="no sample"):
        cell.check()
    fingers.clear_fault()
    cell.clock.advance(0.02)
    with pytest.raises(DeviceFault, match="has sent no sample"):
        cell.check()
    cell.acknowledge()
    cell.check()


def test_injected_finger_faults_show(open_cell):
    cell = open_cell()
    fingers = cell.device(ForceSensor)
    before = fingers.latest().wrenches
    fingers.inject_fault("bias_jump")
    cell.clock.advance(0.002)
    assert fingers.latest().wrenches[0, 2] == pytest.approx(before[0, 2] - 1.0, abs=0.3)
    fingers.inject_fault("dead_left")
    cell.clock.advance(0.002)
    assert np.all(fingers.latest().wrenches[0] == 0.0)


def test_the_grip_holds_through_a_safe_stop(open_cell, probe_of, pick_with):
    cell = open_cell(seed=6, fruit="apple_4")
    probe = probe_of(cell)
    pick_with(probe)
    cell.safe_stop("test")
    for _ in range(100):
        cell.clock.advance(0.02)
    assert cell.truth()["lifted"] is True


def test_resume_is_refused_when_the_fruit_is_gone(open_cell, probe_of, pick_with):
    cell = open_cell(seed=6, fruit="apple_4")
    probe = probe_of(cell)
    pick_with(probe)
    cell.pause()
    for _ in range(10):
        cell.clock.advance(0.02)
        cell.check()
    probe.let_go()
    for _ in range(20):  # somebody takes the fruit out
        probe.gripper.set_speed(0.1)
        cell.clock.advance(0.02)
    with pytest.raises(DeviceFault, match="gone"):
        cell.resume()


CANNOT_BE = {
    "stuck_left": "the left finger has reported the same to the last bit for 30 ms",
    "stuck_right": "the right finger has reported the same to the last bit for 30 ms",
    "stuck": "both fingers have reported the same to the last bit for 30 ms",
    "dead_left": "the left finger has reported zero for 30 ms",
    "dead_right": "the right finger has reported zero for 30 ms",
    "zero": "both fingers have reported zero for 30 ms",
    "not_a_number": "the left finger reports nan instead of a force",
    "infinite": "the left finger reports -inf instead of a force",
    "old": "delivers samples that are 0.5 s old",
    "early": "stamps its samples 10 s in the future",
    "repeated": "repeats its sample 10",
}
"""Faults that the stream itself shows, with their messages; the others show only beside other signals."""


@pytest.mark.parametrize("listening", [True, False])
@pytest.mark.parametrize("kind", CANNOT_BE)
def test_an_impossible_value_is_a_fault_within_50_ms_with_or_without_readers(
    open_cell, kind, listening
):
    cell = open_cell()
    fingers = cell.device(ForceSensor)
    received = []
    if listening:
        fingers.subscribe(received.append)
    cell.clock.advance(0.02)
    cell.check()
    fingers.inject_fault(kind)
    cell.clock.advance(0.05)
    with pytest.raises(DeviceFault) as caught:
        cell.check()
    assert caught.value.message == CANNOT_BE[kind]
    assert cell.links()["fingers"] == CANNOT_BE[kind]
    with pytest.raises(DeviceFault, match="still"):
        cell.acknowledge()
    count = len(received)
    cell.clock.advance(0.02)
    assert len(received) == count  # nobody acts on it any more
    fingers.clear_fault()
    fingers.subscribe(received.append)
    cell.clock.advance(0.02)
    cell.acknowledge()
    cell.check()
    assert len(received) > count


NEVER_ARRIVE = ("not_a_number", "infinite", "old", "early", "repeated")
SLOW = ("drifts_along", "drifts_pressing")


def test_slow_lies_grow_from_when_they_begin():
    before = WrenchSample(3.0, 1, np.ones((2, 6)), (False, False))
    said = {
        kind: [LIES[kind](replace(before, stamp=t), before).wrenches for t in (3.0, 5.0)]
        for kind in SLOW
    }
    assert all((first == 1.0).all() for first, _ in said.values())
    later = {kind: last for kind, (_, last) in said.items()}
    assert later["drifts_along"][:, 0] == pytest.approx([2.0, 2.0])
    assert later["drifts_pressing"][:, 2] == pytest.approx([0.0, 1.0])


SCALES = {"halved": 0.5, "doubled": 2.0}


@pytest.mark.parametrize("kind", SCALES)
def test_a_wrong_gain_scales_the_wrenches(kind):
    sample = WrenchSample(3.0, 1, np.ones((2, 6)), (False, False))
    assert (LIES[kind](sample, sample).wrenches == SCALES[kind]).all()


@pytest.mark.parametrize(
    "kind", [kind for kind in LIES if kind not in (*NEVER_ARRIVE, *SLOW, *SCALES)]
)
def test_every_plausible_sensor_fault_changes_the_samples_until_it_is_cleared(open_cell, kind):
    cell = open_cell()
    fingers = cell.device(ForceSensor)
    samples = []
    fingers.subscribe(samples.append)
    cell.clock.advance(0.02)
    fingers.inject_fault(kind)
    cell.clock.advance(0.02)
    fingers.clear_fault()
    cell.clock.advance(0.02)
    honest, lying = samples[:10], samples[10:20]
    assert all(
        sample.stamp == pytest.approx(0.002 * (n + 1)) for n, sample in enumerate(samples[20:], 20)
    )
    if kind == "swapped":
        left, right = (np.mean([s.wrenches[i, :3] for s in honest], axis=0) for i in range(2))
        assert np.mean([s.wrenches[0, :3] for s in lying], axis=0) == pytest.approx(right, abs=0.1)
        assert np.mean([s.wrenches[1, :3] for s in lying], axis=0) == pytest.approx(left, abs=0.1)
    elif kind == "clipped_left":
        assert np.abs([sample.wrenches[0, :3] for sample in lying]).max() <= 0.5
    elif kind == "coarse":
        steps = np.array([sample.wrenches[:, :3] for sample in lying]) / 0.5
        assert (steps == np.round(steps)).all()
    else:
        truth = fingers.latest().wrenches  # nothing touches: noise and bias
        changed = [not np.allclose(s.wrenches, truth, atol=0.4) for s in lying]
        still = len({s.wrenches[i].tobytes() for s in lying for i in range(2)}) < 20
        assert all(changed) or still


@pytest.mark.parametrize("kind", DELAYS)
def test_a_delay_line_delivers_old_samples_in_order_once(kind):
    delay, line = DELAYS[kind], deque()
    sent = [WrenchSample(0.002 * n, n, np.full((2, 6), float(n))) for n in range(400)]
    came = [(sample, late) for sample in sent if (late := delay.pass_on(line, sample)) is not None]
    values = [int(late.wrenches[0, 0]) for _, late in came]
    assert values == list(range(len(values)))
    assert (
        max(b.sequence - a.sequence for (a, _), (b, _) in pairwise(came)) == 2
    )  # it fills without a gap
    ages = [sample.stamp - late.stamp for sample, late in came]
    true_ages = [
        0.002 * (sample.sequence - value) for (sample, _), value in zip(came, values, strict=True)
    ]
    assert true_ages[-1] == pytest.approx(delay.duration)
    assert max(np.diff(true_ages)) < 0.0021
    assert ages == pytest.approx([0.0] * len(ages) if delay.hidden else true_ages)
