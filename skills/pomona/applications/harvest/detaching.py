"""Detaching a hanging fruit: draw it out lightly and roll the hand until its stem breaks.

The hand draws the fruit with a small force by admittance and turns about its approach axis. The stem then breaks by
bending, at a fraction of the force of a straight pull. One
`DetachController` serves one grasp; it knows no device: each step takes the pads' wrenches and returns velocities.

The roll is measured from the hand's pose. The set-points wait for a hand that is slow or was paused, and so does the
clock of the path: the same path follows at any speed. The clock of forces runs on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from pomona.applications.harvest.stem_test import FURTHEST, StemTest
from pomona.executive import Float64
from pomona.skills import rot_z

GRAVITY = 9.81  # [m/s²]

BRUISE_FORCE, BRUISE_DIAMETER = 7.4, 0.076
"""Pad force at which the flesh of a fruit of this diameter browns [N, m]; it grows with the square (Hertz)."""


class DetachPhase(Enum):
    """State of a detaching hand."""

    CLOSE = "closing"
    DRAW = "drawing"
    ROLL = "rolling"
    LAST_PULL = "pulling harder"
    BACK = "moving back"
    LET_BACK = "letting the branch back"
    TEST = "testing the stem"
    OPEN = "opening"
    LEAVE = "leaving the fruit"
    DONE = "done"


DRAWING = (DetachPhase.DRAW, DetachPhase.ROLL, DetachPhase.LAST_PULL)
"""Phases in which the stem is loaded and may break."""

HOLDING = (*DRAWING, DetachPhase.BACK, DetachPhase.LET_BACK, DetachPhase.TEST)
"""Phases in which the pads hold the fruit by their force."""


@dataclass(frozen=True, slots=True)
class DetachSettings:
    """Numbers of the motion, from the probe in 76 simulated picks where nothing else is named.

    Attributes:
        touch: pad force that counts as contact [N]; first_grip: grip force of each pad before drawing [N].
        untouched: largest force on a pad before the grip [N]: 28 offsets of a wall had 0.25 N, wood 0.55 to 1.4.
        closing, closing_touched: speed of the opening while closing, before and after the first contact [m/s].
        yielding: speed of the hand along the finger axis per force difference of the pads while closing [m/s per N].
        pull: force by which the fruit is drawn [N]; pull_time: time in which it grows [s].
        last_pull, last_pull_time: force to which the pull grows when a roll has not broken the stem [N], as far as
            friction holds the fruit, and the time for it [s].
        outwards: direction of the pull in the base frame, from the wall to the robot and a little upwards, shape (3,).
        admittance: speed per force error [m/s per N]; speed_max: of the hand [m/s].
        roll_after: time of drawing before the hand turns [s]; roll_rate [rad/s]; roll_acceleration [rad/s²].
        mu: assumed friction of the pads; grip_factor, grip_offset: grip force over needed force, and beyond it [N].
        grip_share, grip_ceiling: share of the bruising force that the mean and the larger pad may reach.
        grip_gain: closing speed per missing force [m/s per N]; grip_decay, carried_decay: rates at which
            the force comes down before and after the break [N/s].
        carry_share: share of the bruising force with which a detached fruit is carried: the fingers stand meanwhile,
            and a fruit that turns in the pads by 10° changes its width by up to 1 mm, which is 1 N.
        loaded: stem force that must have been measured before a fall of it counts as a break [N].
        broken_share, broken_force, broken_weight: a stem has broken when its force falls below this share of its recent
            maximum, below this force [N] and below this share of the fruit's weight, which empty pads do not bear.
        first_break: roll before which no stem counts as broken [rad]: in 76 picks none broke below 57°, and a slack
            stem looks the same.
        recent: time over which that maximum is remembered [s].
        loaded_time: time above `broken_force` while the hand moves back that shows a stem which still holds [s].
        quiet_time: time below `broken_force`, after the stem was loaded, that shows a break which was not noticed [s].
        follows_time: time for which a pulled fruit of any weight bears nothing of the pull, that shows it as well [s].
        weight_error: relative, of the weight that the measured size makes likely: 13 % of a half hidden diameter.
        blocked: deviation of the opening from its commands that shows wood at the fingers [m]: less than a gripper's
            supervisor allows. blocked_fading: time constant with which it is forgiven [s].
        jam_force: net force of the pads that no stem needs [N]; jam_force_saturated: difference of the pads' pressing
            forces that shows wood at one finger while its sensor is at the end of its range [N]; jam_press: pad force
            over the bruising force that only wood causes; jam_time: time that any of these may last [s].
        relief, relief_acceleration: time after a jam in which the hand turns back and no further jam counts [s], and
            its acceleration [rad/s²].
        slip_width: loss of opening since the grip at which a fruit is slipping out [m]; twice as much has lost it.
        narrowest: share of the diameter below which closed pads have missed the fruit.
        lost_force: mean pad force below which the fruit is lost [N]; lost_time: duration of that [s].
        empty_force, empty_motor: largest force of a pad, and of the motor, at which pads count as empty [N];
            wider: opening beyond that of the grip at which they are empty though the motor presses [m].
        stiffness: force of each pad per loss of opening [N/m]: that of the pads, since a fruit is harder.
        rough: error of both pads' force by the motor, or by the opening [N]: its steps of 0.5 N and friction; a fruit
            that turns in the pads changes its width.
        doubted: factor of the motor's force over that of both pads, beyond `rough`, at which a grip is given up before
            the fruit is drawn: the pads report too little, or the fingers press on wood.
        least_gain, gain_time: smallest factor on the reported forces while motor and opening both show less, and its
            time constant [s].
        let_back_force: pads' force at which a branch that was drawn has come back [N].
        given_back: work that a held fruit gives the hand beyond what the hand put in and what its weight gives as it
            sinks, at which the pads' forces contradict the motion [J]: fruit, stem and branch are passive; in
            22 attempts at a wall with full leaves they gave 0.08 J, its weight's fall included.
        firm: share of the carrying force at which a detached fruit is moved; firm_time: longest wait for it [s].
        back_distance, back_speed, back_acceleration: of the way to the robot after the break [m, m/s, m/s²].
        opened, opening: opening around a fruit that stays on the tree [m], and its speed [m/s]; stuck: distance by
            which fingers that meet wood may lag meanwhile [m]: less than a supervisor allows.
        leaving, leaving_speed, leaving_acceleration: of the way of the open hand back from the fruit [m, m/s, m/s²].
        turn_behind, turn_held: share of the roll's largest lead, and time, that show an open hand that is held [s].
        lead, lead_angle: by which the set-point may lead a hand at rest [m, rad]; lead_time: and the way of a moving
            hand in this time is added [s]: the arm follows its set-points 0.1 to 0.15 s later.
        lead_most: largest lead [m].
        closing_patience, leaving_patience, patience: longest time of closing, of opening and of the way back from the
            fruit, and of all phases together, on the clock of the path [s]; after twice the last no break is
            recognised any more.
        slowest: speed of the slowest arm, as a share: the last patience over it bounds the real time.
    """

    touch: float = 0.2
    untouched: float = 0.5
    first_grip: float = 2.0
    closing: float = 0.06
    closing_touched: float = 0.03
    yielding: float = 0.004
    pull: float = 3.0
    last_pull: float = 8.0
    last_pull_time: float = 1.2
    pull_time: float = 0.3
    outwards: tuple[float, float, float] = (0.0, 0.94, 0.34)
    admittance: float = 0.01
    speed_max: float = 0.12
    roll_after: float = 0.9
    roll_rate: float = np.pi / 2.0
    roll_acceleration: float = 6.0
    mu: float = 0.6
    grip_factor: float = 1.3
    grip_offset: float = 0.3
    grip_share: float = 0.72
    grip_ceiling: float = 0.8
    grip_gain: float = 0.012
    grip_decay: float = 2.0
    carried_decay: float = 10.0
    carry_share: float = 0.6
    loaded: float = 1.2
    loaded_time: float = 0.06
    quiet_time: float = 0.16
    follows_time: float = 0.4
    weight_error: float = 0.4
    broken_share: float = 0.5
    broken_force: float = 1.0
    broken_weight: float = 0.5
    first_break: float = 0.35
    recent: float = 0.12
    blocked: float = 5e-3
    blocked_fading: float = 2.0
    jam_force: float = 14.0
    jam_force_saturated: float = 4.0
    jam_press: float = 1.15
    jam_time: float = 0.06
    relief: float = 0.6
    relief_acceleration: float = 20.0
    slip_width: float = 0.008
    narrowest: float = 0.75
    lost_force: float = 0.15
    lost_time: float = 0.06
    empty_force: float = 0.3
    empty_motor: float = 4.0
    wider: float = 4e-3
    stiffness: float = 1000.0
    rough: float = 1.5
    doubted: float = 1.3
    least_gain: float = 0.4
    gain_time: float = 0.1
    let_back_force: float = 0.5
    given_back: float = 0.1
    firm: float = 0.7
    firm_time: float = 0.3
    back_distance: float = 0.12
    back_speed: float = 0.25
    back_acceleration: float = 1.0
    opened: float = 0.02
    opening: float = 0.06
    stuck: float = 4e-3
    leaving: float = 0.10
    leaving_speed: float = 0.15
    leaving_acceleration: float = 1.0
    turn_behind: float = 0.8
    turn_held: float = 0.2
    lead: float = 0.008
    lead_angle: float = 0.06
    lead_time: float = 0.25
    lead_most: float = 0.025
    closing_patience: float = 2.0
    leaving_patience: float = 2.0
    patience: float = 10.0
    slowest: float = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class HeldFruit:
    """Known properties of the fruit between the pads.

    Attributes:
        diameter: largest [m]; mass: estimated from it [kg].
        p_base_knuckle: where the stem sits on its spur, shape (3,) [m].
    """

    diameter: float
    mass: float
    p_base_knuckle: Float64

    @property
    def bruise_force(self) -> float:
        """Pad force at which the flesh browns [N]."""
        return BRUISE_FORCE * (self.diameter / BRUISE_DIAMETER) ** 2


@dataclass(frozen=True, slots=True, eq=False)
class DetachCommand:
    """Velocities of one step."""

    velocity: (
        Float64  # of the point about which the hand turns, in the base frame, shape (3,) [m/s]
    )
    roll_rate: float  # of the hand about its approach axis, counterclockwise about z [rad/s]
    opening: float  # rate of the gripper's opening, negative closes [m/s]
    lever: Float64  # from that point to the TCP in the TCP's frame, shape (3,) [m]

    def moved(
        self, T_base_tcp: Float64, dt: float, turns: bool = True, moves: bool = True
    ) -> Float64:
        """Return a pose after `dt` [s] of this command, or of its turn or its motion alone, shape (4, 4)."""
        T = T_base_tcp.copy()
        if turns:
            T[:3, :3] = T_base_tcp[:3, :3] @ rot_z(dt * self.roll_rate)
            T[:3, 3] += (T[:3, :3] - T_base_tcp[:3, :3]) @ self.lever
        if moves:
            T[:3, 3] += dt * self.velocity
        return T


@dataclass(frozen=True, slots=True)
class DetachProblem:
    """Why a fruit was not detached: code, sentence and measured values."""

    code: str
    message: str


class DetachController:
    """Force, roll and grip of one detaching motion, stepped with the pads' wrenches.

    Attributes:
        phase: of the motion; problem: why it ends without a fruit, or None.
        roll: measured angle so far [rad]; stem_force: estimate of the stem's force now [N]; stem_peak: its maximum [N].
        given_back: largest work that the fruit has given the hand beyond its own weight's fall and the work put in [J].
        broke_at: time of the detected break since the start [s], or None; roll_at_break [rad].
        grip_target: grip force that each pad shall have [N].
    """

    def __init__(
        self, fruit: HeldFruit, rolls: tuple[float, ...], settings: DetachSettings | None = None
    ) -> None:
        """
        Args:
            fruit: between the pads.
            rolls: angles to try one after the other, signed [rad]; positive turns counterclockwise about the approach.
            settings: numbers of the motion.
        """
        self.settings = settings if settings is not None else DetachSettings()
        self.phase = DetachPhase.CLOSE
        self.problem: DetachProblem | None = None
        self.roll = self.stem_force = self.stem_peak = self.given_back = 0.0
        self.broke_at: float | None = None
        self.roll_at_break = 0.0
        self._fruit, self._rolls = fruit, list(rolls)
        self._time = self._path = self._since = (
            0.0  # clock of forces; clock of the path, and when the phase began
        )
        self._pace = self._share = (
            1.0  # of the path's clock: while the hand is behind, and as the arm's speed allows
        )
        self._rate = self._aimed = 0.0  # of the roll's set-point [rad/s], and the set-point [rad]
        self._T: Float64 | None = None  # measured pose of the hand, shape (4, 4)
        self._R_start = self._p_aimed = self._p_phase = np.zeros(
            0
        )  # at first; set-point now, and when the phase began
        self._attempt = 0
        self.grip_target = self.settings.first_grip
        self._width_gripped = self._press_gripped = self._speed_back = 0.0
        self._press, self._lever = (
            np.zeros(2),
            np.zeros(3),
        )  # from the knuckle to the TCP, in the TCP's frame [m]
        self._recent: list[tuple[float, float]] = []
        self._least = (0.0, 0.0)  # force of the stem at its likeliest weight, and that weight [N]
        self._free: Float64 | None = (
            None  # force of the pads on the fruit since the stem broke, shape (3,) [N]
        )
        self._jammed = self._empty = self._quiet = self._follows = self._loaded = (
            self._turn_behind
        ) = 0.0
        self._work, self._highest = (
            0.0,
            -np.inf,
        )  # of the hand on the held fruit [J]; its highest place so far [m]
        self._ending: DetachProblem | None = None
        self._test = StemTest()
        self._seemed_free = self._came = self._pulls_down = (
            False  # by load; in a test; as the reach ends
        )
        self._motor: float | None = None
        self._gain = 1.0  # true over reported force of the pads
        self._opening = self._behind = self._unfollowed = (
            0.0  # commanded rate; motion not followed since a jam, ever
        )
        self._width = np.nan
        self._relieved_until = self._furthest = self._opened_from = (
            0.0  # the last is an opening [m]
        )
        self._relieved = self._stays_rolled = False

    @property
    def grip_limit(self) -> float:
        """Largest grip force that is asked for [N]."""
        return self.settings.grip_share * self._fruit.bruise_force

    @property
    def _carried(self) -> float:
        """Grip force with which a detached fruit is carried [N]."""
        return self.settings.carry_share * self._fruit.bruise_force

    def step(
        self,
        dt: float,
        wrenches: Float64,
        saturated: bool,
        T_base_tcp: Float64,
        width: float,
        T_base_aimed: Float64 | None = None,
        motor_force: float | None = None,
    ) -> DetachCommand:
        """Advance by one period.

        Args:
            dt: period [s]; after a pause one usual period, and `rejoin` first.
            wrenches: of the fruit on the pads without the sensors' offset, as in `WrenchSample`, shape (2, 6).
            saturated: whether a pad's sensor is at the end of its range.
            T_base_tcp: measured pose of the hand, shape (4, 4).
            width: opening of the gripper [m].
            T_base_aimed: its set-point, which leads it; the measured pose by default.
            motor_force: as in `GripperState` [N].
        """
        is_first, before = self._T is None, T_base_tcp if self._T is None else self._T
        self._note_pose(dt, T_base_tcp, T_base_tcp if T_base_aimed is None else T_base_aimed)
        self._time, self._path = self._time + dt, self._path + self._share * self._pace * dt
        self._motor = motor_force
        wrenches = self._plausible(dt, wrenches, width)
        press = self._press = -wrenches[:, 2]
        force = _on_fruit(wrenches, T_base_tcp[:3, :3])
        self._note_stem(force)
        self._note_work(wrenches, saturated, before, width)
        self._note_opening(dt, width)
        command = STILL
        touched = float(np.linalg.norm(wrenches[:, :3], axis=1).max())
        if is_first and touched > self.settings.untouched:
            words = f"a pad feels {touched:.1f} N before the grip: something leans on it, or its offset has changed"
            self._finish(DetachProblem("CONTACT", words))
        elif self.phase is DetachPhase.CLOSE:
            command = self._close(press, width)
        elif self.phase in (DetachPhase.OPEN, DetachPhase.LEAVE):
            command = self._leave(dt, T_base_tcp, width)
        elif self.phase is not DetachPhase.DONE:
            self._judge(dt, press, force, saturated, width)
            if self.phase not in (DetachPhase.DONE, DetachPhase.OPEN):
                velocity, lever = self._move(dt, press, force)
                command = DetachCommand(
                    velocity, self._rate, self._grip(dt, wrenches, width), lever
                )
        self._opening = command.opening
        return replace(
            command,
            velocity=self._pace * command.velocity,
            roll_rate=self._pace * command.roll_rate,
        )

    def stand(
        self, dt: float, wrenches: Float64, width: float, motor_force: float | None = None
    ) -> float:
        """Return the rate of the opening while the hand stands, in a pause: only the force of a grip goes on [m/s].

        Args:
            dt, wrenches, width, motor_force: as in `step`.
        """
        self._motor = motor_force
        wrenches = self._plausible(dt, wrenches, width)
        press = -wrenches[:, 2]
        if self.phase in HOLDING and press.min() > self.settings.touch:
            return self._grip(dt, wrenches, width)
        s = self.settings
        loose = self.phase in HOLDING and self._is_loose(press, width)
        return float(np.clip(s.grip_gain * (press.max() - self.grip_limit), 0.0, s.closing)) * (
            not loose
        )

    def rejoin(self) -> None:
        """Go on after a pause: the motion meanwhile is not compared with commands."""
        self._width, self._opening = np.nan, 0.0
        self._rate = self._speed_back = 0.0

    def slowed(self, share: float) -> None:
        """Note which share of the last command the arm's speed allows."""
        self._share = share

    def end_roll(self) -> None:
        """Take the present roll for the end of this way: the arm reaches no further."""
        if self.phase in (DetachPhase.ROLL, DetachPhase.LAST_PULL):
            self._rolls[self._attempt] = self._aimed

    def give_up(self, code: str, message: str) -> None:
        """End the motion: let a branch that was drawn back, else stop."""
        if self.phase in DRAWING:
            self._let_back(DetachProblem(code, message))
        elif self.phase is DetachPhase.BACK:
            self._end(None)
        elif self.phase is DetachPhase.LET_BACK:
            self._end(self._ending)
        elif self.phase is DetachPhase.TEST and not self._pulls_down:
            self._pulls_down, self._test, self._p_phase = True, StemTest(), self._p_aimed
        elif self.phase is DetachPhase.TEST:
            self._finish(
                DetachProblem(
                    "STEM_UNCLEAR", f"{message}; the fruit may be off the tree; the grip is kept"
                )
            )
        elif self.phase is DetachPhase.LEAVE:
            self._enter(DetachPhase.DONE)

    # ------------------------------------------------------------------------------------------- what is felt

    def _note_pose(self, dt: float, T: Float64, T_aimed: Float64) -> None:
        """Measure the roll, and slow the path's clock down while the hand is far behind its set-point."""
        s, before = self.settings, self._T
        if before is None:
            before = T
            self._R_start = T[:3, :3].copy()
        roll = _roll_between(self._R_start, T[:3, :3], self.roll)
        turning = abs(roll - self.roll) / max(dt, 1e-6)
        speed = float(np.linalg.norm(T[:3, 3] - before[:3, 3])) / max(dt, 1e-6)
        self.roll, self._T, self._p_aimed = roll, T.copy(), T_aimed[:3, 3].copy()
        self._aimed = _roll_between(self._R_start, T_aimed[:3, :3], roll)
        self._furthest = max(self._furthest, abs(roll))
        behind = float(np.linalg.norm(T_aimed[:3, 3] - T[:3, 3])) / min(
            s.lead + s.lead_time * speed, s.lead_most
        )
        unturned = abs(self._aimed - roll) / (s.lead_angle + s.lead_time * turning)
        self._turn_behind = self._turn_behind + dt if unturned > s.turn_behind else 0.0
        behind = behind if self._stays_rolled else max(behind, unturned)
        self._pace = float(np.clip(2.0 * (1.0 - behind), 0.0, 1.0))

    def _plausible(self, dt: float, wrenches: Float64, width: float) -> Float64:
        """Return the wrenches, scaled down while motor and opening both show that the pads report too much force."""
        s, total = self.settings, float(-wrenches[:, 2].sum())
        if self.phase in HOLDING and self._motor is not None:
            likely = sorted((total, self._motor, self._squeezed(width)))[1]
            gain = max(likely / total, s.least_gain) if total > likely + s.rough else 1.0
            self._gain += min(dt / s.gain_time, 1.0) * (gain - self._gain)
        return self._gain * wrenches

    def _squeezed(self, width: float) -> float:
        """Return the force of both pads by the opening since the grip [N]."""
        return 2.0 * (self._press_gripped + self.settings.stiffness * (self._width_gripped - width))

    def _note_stem(self, force: Float64) -> None:
        """Estimate the stem's force on the fruit: the weight minus the pads' force."""
        s, weight = self.settings, GRAVITY * self._fruit.mass
        likely = float(
            np.clip(force[2], (1.0 - s.weight_error) * weight, (1.0 + s.weight_error) * weight)
        )
        self.stem_force = float(
            np.linalg.norm(force - ([0.0, 0.0, weight] if self._free is None else self._free))
        )
        self._least = float(np.linalg.norm(force - [0.0, 0.0, likely])), likely
        self._recent.append((self._time, self.stem_force))
        self._recent = [
            each for each in self._recent if each[0] > self._time - self.settings.recent
        ]

    def _note_work(self, wrenches: Float64, saturated: bool, before: Float64, width: float) -> None:
        """Add up the work of the hand on the fruit that the pads hold: of the way and of the turn.

        A sensor at the end of its range reports too little: its work counts as put in.
        """
        assert self._T is not None
        if self.phase not in HOLDING:
            return
        force, torque = _on_pads(wrenches, width)
        work = -float(
            force @ before[:3, :3].T @ (self._T[:3, 3] - before[:3, 3])
            + torque @ _turned(before, self._T)
        )
        self._work += abs(work) if saturated else work
        self._highest = max(self._highest, float(self._T[2, 3]))
        self.given_back = max(self.given_back, -self._work - self._sunk)

    @property
    def _sunk(self) -> float:
        """Energy that the fruit's weight has given since the hand was highest [J]."""
        assert self._T is not None
        return GRAVITY * self._fruit.mass * (self._highest - float(self._T[2, 3]))

    def _contradicts_motion(self) -> bool:
        """Return True if the fruit seems to drive the hand: forces of exchanged or reversed pads do."""
        return self._work < -self.settings.given_back - self._sunk

    def _note_opening(self, dt: float, width: float) -> None:
        """Compare the opening with its commands."""
        moved = 0.0 if np.isnan(self._width) else width - self._width
        fading, asked = np.exp(-dt / self.settings.blocked_fading), self._opening * dt
        self._behind = self._behind * fading + asked - moved
        asked += (
            self._unfollowed * fading
        )  # as a supervisor counts it: a push without a command is no lag
        self._unfollowed = asked - moved if (asked - moved) * asked > 0.0 else 0.0
        self._width = width

    def _judge(
        self, dt: float, press: Float64, force: Float64, saturated: bool, width: float
    ) -> None:
        s = self.settings
        beside = saturated and abs(press[0] - press[1]) > s.jam_force_saturated
        over = press.max() > s.jam_press * self._fruit.bruise_force
        jams = self._on_the_tree and (beside or over or np.linalg.norm(force) > s.jam_force)
        if self.phase in DRAWING:
            self.stem_peak = max(self.stem_peak, self.stem_force)
        self._jammed = self._jammed + dt if jams and self._path > self._relieved_until else 0.0
        self._empty = self._empty + dt if press.mean() < s.lost_force else 0.0
        if self._contradicts_motion():
            words = f"the fruit seems to have driven the hand with {-self._work:.2f} J: the pads' forces contradict its"
            self._finish(DetachProblem("STEM_UNCLEAR", f"{words} motion; the grip is kept"))
        elif self._jammed > s.jam_time:
            words = f"the pads feel {press[0]:.1f} and {press[1]:.1f} N, {np.linalg.norm(force):.1f} N in all"
            self._jam(DetachProblem("JAMMED", words))
        elif self._is_blocked() and self._path > self._relieved_until:
            self._jam(self._blocked(width))
        elif self._empty > s.lost_time or width < self._width_gripped - 2.0 * s.slip_width:
            self._left_the_pads(press)
        elif self.phase in (*DRAWING, DetachPhase.LET_BACK, DetachPhase.TEST) and self._is_free(
            dt, press
        ):
            self._break(np.array([0.0, 0.0, self._least[1]]))
        elif self.phase in DRAWING:
            if width < self._width_gripped - s.slip_width:
                self._let_back(
                    DetachProblem("SLIPPED", f"the opening fell by {1e3 * s.slip_width:.0f} mm")
                )
            elif max(self._path, s.slowest * self._time) > s.patience:
                self._let_back(
                    DetachProblem("NOTHING_BROKE", f"the stem held for {s.patience:.0f} s")
                )
        elif self.phase is DetachPhase.BACK:
            self._loaded = self._loaded + dt if self.stem_force > self._broken_force else 0.0
            if self._loaded > s.loaded_time:
                self.broke_at = self._free = None
                self._speed_back = self._loaded = 0.0
                self._enter(DetachPhase.ROLL)

    @property
    def _broken_force(self) -> float:
        """Force below which a stem bears nothing [N]."""
        s = self.settings
        return min(s.broken_force, s.broken_weight * GRAVITY * self._fruit.mass)

    def _is_free(self, dt: float, press: Float64) -> bool:
        """Return True if the pads bear the whole fruit: a stem that holds would bear the weight or the pull.

        A fruit that bears no part of the pull for longer may have another weight than its size makes likely.
        """
        s = self.settings
        in_time = (
            max(self._path, s.slowest * self._time) < 2.0 * s.patience
        )  # a load that comes and goes has an end
        turned = self._furthest > s.first_break
        unloaded = (
            in_time and turned and press.min() > s.touch and self.stem_force < self._broken_force
        )
        self._quiet = self._quiet + dt if unloaded else 0.0
        pulled = self.phase in (DetachPhase.ROLL, DetachPhase.LAST_PULL)
        follows = (
            in_time
            and turned
            and press.min() > s.touch
            and pulled
            and self._least[0] < 0.5 * self._broken_force
        )
        self._follows = self._follows + dt if follows else 0.0
        most = max(each for _, each in self._recent)
        falls = (
            self.phase in DRAWING and most > s.loaded and self.stem_force < s.broken_share * most
        )
        return (
            unloaded and (falls or self._quiet > s.quiet_time)
        ) or self._follows > s.follows_time

    def _jam(self, problem: DetachProblem) -> None:
        """Turn the hand back from wood: roll the other way if that was not tried; end if turning back did not help."""
        self._relieved_until, self._jammed, self._behind = (
            self._path + self.settings.relief,
            0.0,
            0.0,
        )
        relieved, self._relieved = self._relieved, True
        if self.phase in (DetachPhase.ROLL, DetachPhase.LAST_PULL) and self._attempt + 1 < len(
            self._rolls
        ):
            self._attempt += 1
            self._relieved = False
            self._enter(DetachPhase.ROLL)
        elif self.phase in DRAWING:
            self._let_back(problem)
        elif relieved or self.phase is not DetachPhase.LET_BACK:
            self._end(problem)

    def _is_blocked(self) -> bool:
        """Return True if wood pushes or blocks the fingers: until the stem has broken they follow their commands."""
        return self._on_the_tree and abs(self._behind) > self.settings.blocked

    @property
    def _on_the_tree(self) -> bool:
        return self.broke_at is None and self.phase is not DetachPhase.TEST

    def _blocked(self, width: float) -> DetachProblem:
        words = f"the opening is {1e3 * abs(self._behind):.0f} mm off its commands, at {1e3 * width:.0f} mm"
        return DetachProblem("JAMMED", f"{words}: something pushes or blocks the fingers")

    def _left_the_pads(self, press: Float64) -> None:
        """End with the pads open only if they are empty and the fruit is on the tree."""
        if self._is_empty(press):
            freed = self.broke_at is not None or self._seemed_free
            code, words = (
                ("LOST", "after the stem broke") if freed else ("SLIPPED", "before the stem broke")
            )
            self._end(DetachProblem(code, f"the fruit left the pads {words}"))
        elif self.phase is not DetachPhase.TEST:
            when = (
                "before the stem broke"
                if self.broke_at is None
                else f"after the break: {self._pads_feel(press)}"
            )
            self._end(DetachProblem("SLIPPED", f"the fruit was leaving the pads {when}"))

    def _is_empty(self, press: Float64) -> bool:
        """Return True if the pads feel nothing, and either the motor agrees or they stand wider than at the grip.

        Leaves may press on one pad: where the other and the motor feel nothing, pads this close have no fruit either.
        """
        s = self.settings
        agrees = self._motor is None or abs(self._motor) < s.empty_motor
        if press.max() < s.empty_force:
            return agrees or self._width > self._width_gripped + s.wider
        missed = self._motor is not None and self._width < s.narrowest * self._fruit.diameter
        return missed and agrees and bool(press.min() < s.empty_force)

    def _pads_feel(self, press: Float64) -> str:
        motor = "" if self._motor is None else f", the motor presses with {self._motor:.1f} N"
        return f"the pads feel {press[0]:.1f} and {press[1]:.1f} N{motor}"

    def _break(self, free: Float64) -> None:
        """The fruit is off the tree, and the pads bear it with this force, shape (3,) [N]."""
        self._loaded, self._follows, self._seemed_free = 0.0, 0.0, True
        self._free = free
        self.broke_at, self.roll_at_break = self._time, self.roll
        self._enter(DetachPhase.BACK)

    # --------------------------------------------------------------------------------------------- motions

    def _close(self, press: Float64, width: float) -> DetachCommand:
        s, T = self.settings, self._T
        assert T is not None
        if press.min() > s.touch:
            missing = s.first_grip - float(press.mean())
            if missing < 0.2 * s.first_grip:
                if (
                    self._motor is not None
                    and self._motor > s.doubted * float(press.sum()) + s.rough
                ):
                    self._end(DetachProblem("JAMMED", self._pads_feel(press)))
                    return STILL
                self._width_gripped = width
                self._press_gripped = float(
                    press.max()
                )  # a fruit that hangs free is pressed alike by both pads
                self._lever = T[:3, :3].T @ (T[:3, 3] - self._fruit.p_base_knuckle)
                self._enter(DetachPhase.DRAW)
            return replace(
                STILL, opening=-float(np.clip(s.grip_gain * missing, -s.closing, s.closing))
            )
        if self._time > s.closing_patience or width < s.narrowest * self._fruit.diameter:
            self._end(DetachProblem("NOT_GRIPPED", f"after closing {self._pads_feel(press)}"))
            return STILL
        if self._is_blocked():
            self._end(self._blocked(width))
            return STILL
        aside = s.yielding * float(press[0] - press[1]) * T[:3, 1]
        return replace(
            STILL,
            velocity=aside,
            opening=-(s.closing_touched if press.max() > s.touch else s.closing),
        )

    def _move(self, dt: float, press: Float64, force: Float64) -> tuple[Float64, Float64]:
        """Velocity of the point about which the hand turns, and the lever from it, in the frames of `DetachCommand`."""
        s, since = self.settings, self._path - self._since
        outwards = np.array(s.outwards)
        if self.phase is DetachPhase.BACK:
            self._turn(dt, 0.0)
            if (
                self._speed_back == 0.0
                and press.mean() < s.firm * self._carried
                and since < s.firm_time
            ):
                return np.zeros(3), np.zeros(3)
            left = s.back_distance - float(np.linalg.norm(self._p_aimed - self._p_phase))
            if left < 2e-3:
                self._end(None)
            self._speed_back = min(self._speed_back + s.back_acceleration * dt, s.back_speed)
            self._speed_back = min(
                self._speed_back, float(np.sqrt(max(2.0 * s.back_acceleration * left, 0.0)))
            )
            return self._speed_back * outwards / float(np.linalg.norm(outwards)), np.zeros(3)
        if self.phase is DetachPhase.TEST:
            self._turn(dt, 0.0)
            way = (
                np.array([0.0, 0.0, -1.0])
                if self._pulls_down
                else outwards / float(np.linalg.norm(outwards))
            )
            return self._tested(dt, force, way), np.zeros(3)
        pull = s.pull * min(since / s.pull_time, 1.0) if self.phase is DetachPhase.DRAW else s.pull
        if self.phase is DetachPhase.LET_BACK:
            pull = 0.0
            self._turn_to(dt, 0.0)
            at_rest = np.linalg.norm(force) < s.let_back_force and abs(self.roll) < 0.1
            if at_rest or since > s.closing_patience:
                self._end(self._ending)
        elif self.phase is DetachPhase.DRAW and since > s.roll_after:
            self._enter(DetachPhase.ROLL)
        elif self.phase is DetachPhase.ROLL:
            self._turn_to(dt, self._rolls[self._attempt])
            if abs(self.roll - self._rolls[self._attempt]) < 0.02:
                self._enter(DetachPhase.LAST_PULL)
        elif self.phase is DetachPhase.LAST_PULL:
            self._turn_to(dt, self._rolls[self._attempt])
            hardest = max(s.pull, min(s.last_pull, 2.0 * s.mu * self.grip_limit))
            pull = s.pull + (hardest - s.pull) * min(since / s.last_pull_time, 1.0)
            if since > 1.5 * s.last_pull_time and self._attempt + 1 < len(self._rolls):
                self._attempt += 1
                self._enter(DetachPhase.ROLL)
            elif since > 1.5 * s.last_pull_time:
                tried = " and ".join(f"{np.degrees(roll):.0f}°" for roll in self._rolls)
                words = f"the stem held rolls of {tried} and a pull of {hardest:.0f} N"
                self._let_back(DetachProblem("NOTHING_BROKE", words))
        return _shortened(s.admittance * (pull * outwards - force), s.speed_max), self._lever

    def _tested(self, dt: float, force: Float64, outwards: Float64) -> Float64:
        """Pull at the fruit that way, and let it go only if the stem pulls back.

        A fruit that comes along over the whole way, with its weight on the pads, is off the tree: a branch pulls back.
        """
        moved = float((self._p_aimed - self._p_phase) @ outwards)
        speed = self._test.step(dt, float(force @ outwards), moved)
        if self._test.holds is not None and self._ending is not None:
            comes = self._test.furthest > FURTHEST and force[2] > 0.5 * GRAVITY * self._fruit.mass
            if (
                not self._test.holds and comes and not self._came
            ):  # the fruit may have turned to a narrower place
                self._came = True
                self._width_gripped, self._press_gripped = self._width, float(self._press.max())
                self._break(force)
                return np.zeros(3)
            if not self._test.holds:
                far, rise = 1e3 * self._test.furthest, self._test.rise
                words = f"{self._ending.message}, but a pull of {far:.0f} mm changed the force by {rise:.1f} N alone"
                words += ": the fruit may be off the tree; the grip is kept"
                self._ending = DetachProblem("STEM_UNCLEAR", words)
            self._finish(self._ending)
        return speed * outwards

    def _leave(self, dt: float, T_base_tcp: Float64, width: float) -> DetachCommand:
        """Open around a fruit that stays on the tree, then draw the hand straight back and out of its roll.

        Fingers that meet wood open no further: they would push the arm off its place. A hand that is held in its roll
        goes back as it is.
        """
        s, since = self.settings, self._path - self._since
        self._stays_rolled = self._stays_rolled or self._turn_behind > s.turn_held
        self._turn_to(dt, self.roll if self._stays_rolled else 0.0)
        if self.phase is DetachPhase.OPEN:
            wide = width > self._opened_from + s.opened - 1e-3 or since > s.leaving_patience
            if not wide and self._behind < s.stuck:
                return replace(STILL, roll_rate=self._rate, opening=s.opening)
            self._speed_back = 0.0
            self._enter(DetachPhase.LEAVE)
        left = s.leaving - float(np.linalg.norm(self._p_aimed - self._p_phase))
        most = min(s.leaving_speed, float(np.sqrt(max(2.0 * s.leaving_acceleration * left, 0.0))))
        self._speed_back = min(self._speed_back + s.leaving_acceleration * dt, most)
        if (
            left < 2e-3 or since > s.leaving_patience
        ):  # at the end of its reach the hand may turn, and not move
            self._enter(DetachPhase.DONE)
        return replace(STILL, velocity=-self._speed_back * T_base_tcp[:3, 2], roll_rate=self._rate)

    def _turn_to(self, dt: float, goal: float) -> None:
        s, left = self.settings, goal - self._aimed
        wanted = np.sign(left) * min(
            s.roll_rate, float(np.sqrt(2.0 * s.roll_acceleration * abs(left)))
        )
        self._turn(dt, float(wanted))

    def _turn(self, dt: float, wanted: float) -> None:
        relieving = self._path < self._relieved_until
        most = (
            self.settings.relief_acceleration if relieving else self.settings.roll_acceleration
        ) * dt
        self._rate += float(np.clip(wanted - self._rate, -most, most))

    def _grip(self, dt: float, wrenches: Float64, width: float) -> float:
        """Rate of the opening to the force that holds the larger load; where it is blocked, no further that way.

        Pads that feel nothing are not closed, nor pads of which one may press as hard as the fruit bears.
        """
        s, press = self.settings, -wrenches[:, 2]
        sideways = float(np.hypot(wrenches[:, 0], wrenches[:, 1]).max())
        needed = max(s.grip_factor * sideways / s.mu + s.grip_offset, s.first_grip)
        if self.broke_at is not None:
            needed = max(needed, self._carried)
        needed = min(needed, self.grip_limit)
        decay = s.grip_decay if self.broke_at is None else s.carried_decay
        self.grip_target = max(needed, self.grip_target - decay * dt)
        most = s.grip_ceiling * self._fruit.bruise_force
        missing = min(self.grip_target - press.mean(), most - press.max())
        felt = press.mean() > s.lost_force and press.max() + self._unfelt(press, width) < most
        stuck = (
            self.phase is DetachPhase.TEST and abs(self._behind) > s.stuck
        )  # wood holds the fingers
        least, most = (
            0.0 if self._is_loose(press, width) else -s.closing,
            s.closing if felt else 0.0,
        )
        rate = -float(np.clip(s.grip_gain * missing, least, most))
        return rate * (
            not stuck and (rate * self._unfollowed <= 0.0 or abs(self._unfollowed) <= s.blocked)
        )

    def _unfelt(self, press: Float64, width: float) -> float:
        """Return the force of the pads beyond their reports, by the motor's force, else by the opening [N]."""
        s = self.settings
        force = self._squeezed(width) if self._motor is None else self._motor
        return max(force - s.rough - float(press.sum()), 0.0)

    def _is_loose(self, press: Float64, width: float) -> bool:
        """Return True if fingers that open further may let the fruit fall: one pad alone may report too much."""
        s, beyond = self.settings, width - self._width_gripped
        if self._motor is None:
            return beyond > (s.wider if press.min() > self.grip_limit else 0.0)
        return 0.0 <= 0.5 * self._motor < s.first_grip or beyond > s.wider

    # ---------------------------------------------------------------------------------------------- phases

    def _enter(self, phase: DetachPhase) -> None:
        self.phase, self._since, self._p_phase = phase, self._path, self._p_aimed

    def _let_back(self, problem: DetachProblem) -> None:
        self._ending = problem
        self._enter(DetachPhase.LET_BACK)

    def _end(self, problem: DetachProblem | None) -> None:
        """End; a fruit that may still be between the pads is let go only after a test of its stem."""
        held = self.phase in HOLDING and not self._is_empty(self._press)
        if problem is None or problem.code in KEPT or not held:
            self._finish(problem)
            return
        self._ending, self._speed_back = problem, 0.0
        self._test, self._pulls_down = StemTest(), False
        self._enter(DetachPhase.TEST)

    def _finish(self, problem: DetachProblem | None) -> None:
        self.problem = problem
        self._opened_from, self._behind = self._width, 0.0
        leaves = problem is not None and problem.code not in KEPT
        self._enter(DetachPhase.OPEN if leaves else DetachPhase.DONE)


STILL = DetachCommand(np.zeros(3), 0.0, 0.0, np.zeros(3))
"""Nothing moves."""
KEPT = ("LOST", "STEM_UNCLEAR")
"""Problems after which the fingers stay as they are."""


def _roll_between(R_start: Float64, R: Float64, near: float) -> float:
    """Return the turn about the approach axis from one orientation to another, the one next to `near` [rad]."""
    turned = R_start.T @ R
    roll = float(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
    return near + float(np.mod(roll - near + np.pi, 2.0 * np.pi) - np.pi)


def _on_fruit(wrenches: Float64, R_base_tcp: Float64) -> Float64:
    """Net force of the pads on the fruit in the base frame, shape (3,) [N].

    Pad frames: x along the approach, z out of the face: -y of the hand for the left pad, +y for the right one.
    """
    force: Float64 = -R_base_tcp @ _in_hand(wrenches[:, :3]).sum(axis=0)
    return force


def _in_hand(vectors: Float64) -> Float64:
    """Return the vectors of the left and the right pad, shape (2, 3), in the hand's frame."""
    left, right = vectors
    return np.array([[-left[1], -left[2], left[0]], [right[1], right[2], right[0]]])


def _on_pads(wrenches: Float64, width: float) -> tuple[Float64, Float64]:
    """Net force of the fruit on the pads and its torque about the TCP, shape (3,) each, in the hand's frame [N, N·m].

    The left pad stands at half the opening [m] along y, the right one opposite.
    """
    forces = _in_hand(wrenches[:, :3])
    levers = np.array([[0.0, 0.5 * width, 0.0], [0.0, -0.5 * width, 0.0]])
    torque = _in_hand(wrenches[:, 3:]).sum(axis=0) + np.cross(levers, forces).sum(axis=0)
    return forces.sum(axis=0), torque


def _turned(T_before: Float64, T: Float64) -> Float64:
    """Return the small turn from one pose to another in the hand's frame, shape (3,) [rad]."""
    R = T_before[:3, :3].T @ T[:3, :3]
    return 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])


def _shortened(v: Float64, most: float) -> Float64:
    """Return a vector, not longer than `most`."""
    shortened: Float64 = v * min(1.0, most / max(float(np.linalg.norm(v)), 1e-12))
    return shortened
