"""Is a fruit between the fingers, and is it still there: by the grip, by a force sensor, or by width and motor.

`show_grip` draws a grip on the operator's plot: force over time against the minimum grip force.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from pomona.drivers.fruit_body import HARD_MODULUS, PAD_MODULUS, UNKNOWN_PRESSURE, bruising_force
from pomona.drivers.interfaces import (
    OTHER_FRUIT,
    ForceSensor,
    Gripper,
    Hand,
    LoadSensor,
    Pads,
    PressSensor,
    WrenchSensor,
)
from pomona.drivers.plain_hand import between, gone
from pomona.executive.account import HELD, HELD_FRUIT
from pomona.executive.skill import Skill
from pomona.executive.views import SeriesView
from pomona.skills.grip.hold import Hold, current_hold
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.settings import ForceLoopSettings, GripSettings
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.following import MovingSkill
from pomona.skills.shared.touch import HELD_FORCE, pressing_forces, something_between

GRAVITY = 9.81  # [m/s²]

HAND_DEVICES = (
    ForceSensor,
    PressSensor,
    LoadSensor,
    Hand,
)  # that show a held fruit: a skill's `optional_devices`


def is_held(skill: MovingSkill, hold: Hold | None = None) -> bool:
    """Return True while the fruit is held.

    The given grip decides, or the one that has the fingers; without a grip, see `is_between`.
    """
    grip = _grip(skill, hold)
    return grip.holds if grip is not None else is_between(skill)


def is_between(skill: MovingSkill) -> bool:
    """Return True if force and opening show an object between the fingers.

    Without a force sensor the state of the hand decides, with every doubt; without that, width and motor now.
    """
    gripper = skill.device(Gripper)
    sensor = pressed_fingers(skill)
    hand = skill.optional_device(Hand)
    if sensor is not None:
        return something_between(gripper, sensor)
    return bool(between(gripper.state(), gripper.limits) if hand is None else hand.in_hand())


def pressed_fingers(skill: MovingSkill) -> WrenchSensor | None:
    """Return the sensor of both fingers' pressing forces; None in a cell without one."""
    tips = skill.optional_device(ForceSensor)
    return skill.optional_device(PressSensor) if tips is None else tips


def is_pressed(skill: MovingSkill) -> bool:
    """Return True while a finger is pressed; without force fingers, as `is_between`."""
    sensor = pressed_fingers(skill)
    return is_between(skill) if sensor is None else max(pressing_forces(sensor)) > HELD_FORCE


def watch_fruit(skill: MovingSkill, hold: Hold | None = None) -> Callable[[], str]:
    """Return a function that describes why the fruit that is held now is held no more; empty while it is held.

    Without a force sensor it compares width and motor with those of now.
    """
    gripper = skill.device(Gripper)
    if _grip(skill, hold) is None and pressed_fingers(skill) is None:
        before = gripper.state()
        return lambda: gone(before, gripper.state(), gripper.limits)
    return lambda: "" if is_held(skill, hold) else "it presses on neither finger"


def note_held(skill: MovingSkill, hold: Hold | None, fruit: MeasuredFruit | None) -> None:
    """Add what pads, weight and width show of the held fruit to the account of the task, and what contradicts it."""
    sensor = pressed_fingers(skill)
    width = skill.device(Gripper).state().width
    found = [f"width {1e3 * width:.0f} mm"]
    if hold is not None and not hold.ended:
        reading = hold.reading
        found += [f"pads {reading.f_n:.1f} N", f"weight {reading.f_t:.1f} N"]
        note_press(skill, "the pads", 0.5 * hold.peaks[1], fruit)
        note_press(skill, "its support", hold.press_below, fruit, HARD_MODULUS)
        if fruit is not None:
            skill.account(HELD_FRUIT, "; ".join(_contradictions(width, hold, fruit)))
    elif sensor is not None:
        found.append(f"pads {sum(pressing_forces(sensor)):.1f} N")
    skill.account(HELD, ", ".join(found))


def _contradictions(width: float, hold: Hold, fruit: MeasuredFruit) -> Iterator[str]:
    """Yield where width [m], weight and its lever in the fingers differ from the fruit that was measured and gripped."""
    load = hold.reading.f_t
    if hold.turned > TURNED:
        yield f"the fruit has turned in the pads: the lever of its weight moved by {1e3 * hold.turned:.1f} mm"
    least, most = NARROWEST * float(fruit.dimensions.min()), float(fruit.dimensions.max())
    if not least <= width <= most + CLEARANCE:
        yield f"the pads are {1e3 * width:.0f} mm apart at a fruit of {1e3 * most:.0f} mm"
    known = fruit.mass
    if known and load < (least := 0.5 * GRAVITY * (known[0] - 2.0 * known[1])):
        yield f"the held fruit weighs {load:.1f} N, {least:.1f} N at least for its size"


def expected_load(fruit: MeasuredFruit) -> float:
    """Return the largest expected load of a fruit of this size in a lift [N]; 0 where it is unknown."""
    known = fruit.mass
    # factor on the weight in a lift of 1 m/s²
    return 1.1 * GRAVITY * (known[0] + 2.0 * known[1]) if known else 0.0


def bruising(fruit: MeasuredFruit | None, modulus: float = PAD_MODULUS) -> float:
    """Return the force of one contact that bruises a fruit of this size [N].

    Of an unknown fruit it is that of a large apple: a larger force bruises every one.
    """
    if fruit is None:
        return bruising_force(UNKNOWN_PRESSURE, 0.5 * LARGE, modulus)
    return bruising_force(fruit.fruit.pressure, 0.5 * float(fruit.dimensions[0]), modulus)


def bearable_force(fruit: MeasuredFruit | None) -> float:
    """Return the force of both fingers that bruises no fruit of this size, less a tenth for overshoot [N]."""
    return 1.8 * bruising(fruit)


def note_press(
    skill: Skill, by: str, force: float, fruit: MeasuredFruit | None, modulus: float = PAD_MODULUS
) -> None:
    """Add a measured force on a fruit [N] to the account of the task, as a share of the one that bruises it."""
    share = force / bruising(fruit, modulus)
    skill.account(by, f"{by} pressed a fruit with {force:.1f} N, {share:.2f} of its limit", share)


# opening over the fruit at which a finger may touch [m]: it may lie off the centre
CLEARANCE = 0.008
TURNED = (
    5e-4  # motion of a load's lever that is a turn [m]; in lifts without one it was up to 0.34 mm
)
NARROWEST = 0.5  # smallest width of a fruit between the fingers, relative to its smallest dimension
OFF_CENTRE = 0.003  # largest distance of the fruit's centre from the grip [m]


def grip_settings(skill: Skill, fruit: MeasuredFruit | None, max_force: float) -> GripSettings:
    """Return settings of a grip on this fruit with the cell's pads, gripper and force sensor.

    Args:
        max_force: largest force of both fingers [N]; less where the gripper cannot, or the fruit would bruise.
    """
    pair = skill.device(Pads).on(OTHER_FRUIT if fruit is None else fruit.fruit.name)
    limits = skill.device(Gripper).limits
    loop = ForceLoopSettings(
        stiffness=pair.stiffness,
        max_force=min(max_force, 2.0 * limits.force_max, bearable_force(fruit)),
        step=limits.step,
    )
    grip = GripSettings(
        contact=SoftContact(pair.mu, pair.delta, pair.gamma),
        mu_uncertainty=pair.uncertainty,
        offset=OFF_CENTRE,
        loop=replace(loop, closing_speed=min(loop.closing_speed, limits.speed_max)),
        width_min=limits.width_min,
        rate=skill.device(ForceSensor).rate,
    )
    if fruit is None:
        return grip
    return replace(
        grip,
        expected_load=expected_load(fruit),
        contact_width=float(fruit.dimensions.max()) + CLEARANCE,
        narrowest=NARROWEST * float(fruit.dimensions.min()),
    )


def _grip(skill: MovingSkill, hold: Hold | None) -> Hold | None:
    return hold if hold is not None and not hold.ended else current_hold(skill.device(Gripper))


LARGE = 0.1  # size of a large apple [m]
TOPIC = "grip"


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
    if hold.waiting < 0.1 and not (
        everything and hold.waiting > 0.0
    ):  # seconds of samples in one view
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
            thresholds={"force limit [N]": hold.settings.loop.max_force},
        ),
    )
