"""What a grip's parts are tuned with: every constant has a unit and says where it comes from.

"Lifts" are the random ones of `make bench-grasp`, "picks" those of the simulated cell; docs/decisions/grasp-*.md have
the measurements. A gripper, a sensor or a fruit of another kind may need other values: all are part of `GripSettings`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BiasSettings:
    """Taking the bias with nothing between the fingers.

    Attributes:
        dropped: the stream's first samples are left out for so long [s]; 10 samples at 500 Hz, the paper's.
        time: the bias is the mean of so long [s]; 100 samples at 500 Hz, the paper's.
        longest: up to so long while noise leaves the mean's error larger than `error` [s]; grasp-hump.md.
        error: [N]; with twice this light fruit turned over in lifts with 0.2 N of noise.
        limit: a finger that feels more before the fingers close touches something, or is broken [N].
    """

    dropped: float = 0.02
    time: float = 0.2
    longest: float = 1.6
    error: float = 0.0085
    limit: float = 3.0


@dataclass(frozen=True, slots=True)
class BiasCheckSettings:
    """Which sensor is refused while its bias is taken (grasp-lying-sensors.md).

    Attributes:
        step: largest step of a force [N]: the accuracy of the paper's fingers.
        torque_step: largest step of a torque [N·m]: of that force on a lever of 10 mm.
        copies: largest share of samples that repeat the one before, beyond chance.
    """

    step: float = 0.2
    torque_step: float = 2e-3
    copies: float = 0.1


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """From noisy wrenches to loads; found on lifts with 0.2 N of white noise (grasp-beyond-the-paper.md).

    Attributes:
        fast_lag, normal_lag, load_lag: time constants of the fast filter, and of the slow ones of the normal force and
            of everything else [s].
        rise_lag: the rise of the least force is what it is beyond itself through a low-pass of this time constant [s].
        calm_lag, calm_load: the load and its lever are averaged over so long [s] while nothing pushes; below such an
            average [N] there is no lever.
        longest_push: a push that lasts longer counts as load [s].
        hit_stds, hit_share: a load that grows by less than so many standard deviations of its noise and this share of
            itself within `rise_lag` is not hit; a lift that reaches 3 m/s² within 0.2 s makes it grow by 0.05.
        noise_share: the fast filter counts where it differs from the slow one by so many of its standard deviations.
        farthest_centre: the centre of rotation is taken to be at most so far away [m]; it lies at infinity for a fruit
            that only translates.
        centre_lag: time constant with which the estimated centre of rotation moves [s].
        twist_bound: a twist beyond this counts as this much.
        jump: a force that changes on one finger alone by so much more than noise at once is no load [N].
        quiet: what is beyond noise by less than this is still noise [N].
        aside: a jump of which no more than this share lies across the finger's load is a contact that breaks or forms:
            at most 0.1 in 29 of MuJoCo's; of a wrong normal channel it is the tangential share of the load, there 0.4.
    """

    fast_lag: float = 0.005
    normal_lag: float = 0.06
    load_lag: float = 0.08
    rise_lag: float = 0.03
    calm_lag: float = 0.2
    calm_load: float = 0.2
    longest_push: float = 1.0
    hit_stds: float = 4.0
    hit_share: float = 0.1
    noise_share: float = 2.5
    farthest_centre: float = 0.02
    centre_lag: float = 0.1
    twist_bound: float = 2.0
    jump: float = 0.4
    quiet: float = 0.05
    aside: float = 0.15


@dataclass(frozen=True, slots=True)
class ReferenceSettings:
    """How the reference of the grasp force moves around the static part (grasp-hump.md, grasp-own-motion.md).

    Attributes:
        low_pass: time constant [s]; the paper's 50 Hz.
        edge, edge_gain: where the least force is beyond this share of the measured one and noise, so many times the
            excess is added.
        lead: so many times the rise of the least force beyond noise is added while it rises, and more where the load
            twists the fruit: what it will be when the fingers answer, and no more, since they would have to be opened
            again.
        reserve_margin: on what the reserve asks for, which no noise touches.
        pivot_margin: while pivoting, on the force that Coulomb's law needs for the weight alone.
        pivot_rate: how slowly it is let go to [N/s].
        sliding_rate: how fast the force rises while the pads slide [N/s]; twice `ramp_rate`, in a third of a second.
        hit, slides: so many times what hits a carried fruit is pressed with, over the friction, while the least force
            is beyond this share of the measured one: friction shows no more than the beginning of a push.
        most_urgent: bound of what is added to the static part [N]; enough for the fingers' full speed.
        urgent_base, urgent_share: a light load is answered with less, this much [N] and this share of the least force.
        doubtful: the bound once the sensor is not to be trusted [N].
        distrusted: fingers that contradict themselves raise the force to so many times what held before, at most.
        load_changed: the tangential load of a fruit that stands, which what it stands on bears, has changed when it
            differs by so much [N]; seven times its noise in the simulated cell, reached 5 ms after a lift has begun.
        carried_load, carried_after, carried_rise: a tangential load of so much [N] for so long [s], while the least
            force rises by less than this share beyond noise, is a fruit that is carried: the initial force and the
            caution have done their work.
        relaxing: what the reference is too high by falls by this share a second [1/s], at least at the relax rate.
        excess, excess_relaxing, excess_lag: what is beyond so many times the wanted force, averaged over the last [s],
            falls faster [1/s]: noise does not reach that far.
        bias_stds: so many standard deviations of the bias are covered too where friction is uncertain and the margin
            beyond the worst one is slim: they weigh on light fruit.
        averaged_over, lowered_over: a carried fruit's static part is averaged over the first while it rises and over
            the second while it falls [s]: when a lift slows down the fruit seems lighter.
        averaged_stds: what is beyond the average by more than so many standard deviations of noise counts at once.
        creep_gain, creep_fast, creep_slow, creep_noise: a moment whose share of the least force grows creeps: so many
            times what its average over the second [s] is beyond the one over the third [s], and beyond the fourth.
        least_margin: on top of the worst friction that is possible, where it is uncertain; with 1.05 one fruit of
            1 200 lifts is lost.
    """

    low_pass: float = 1.0 / (2.0 * 3.141592653589793 * 50.0)
    edge: float = 0.95
    edge_gain: float = 5.0
    lead: float = 1.5
    reserve_margin: float = 1.09
    pivot_margin: float = 1.25
    pivot_rate: float = 1.5
    sliding_rate: float = 12.0
    hit: float = 16.0
    slides: float = 0.8
    most_urgent: float = 10.0
    urgent_base: float = 1.0
    urgent_share: float = 1.0
    doubtful: float = 3.0
    distrusted: float = 2.0
    load_changed: float = 0.3
    carried_load: float = 0.25
    carried_after: float = 0.1
    carried_rise: float = 0.05
    relaxing: float = 2.5
    excess: float = 1.2
    excess_relaxing: float = 12.0
    excess_lag: float = 0.15
    bias_stds: float = 2.0
    averaged_over: float = 0.3
    lowered_over: float = 0.6
    averaged_stds: float = 2.0
    creep_gain: float = 6.0
    creep_fast: float = 0.15
    creep_slow: float = 0.6
    creep_noise: float = 0.06
    least_margin: float = 1.06


@dataclass(frozen=True, slots=True)
class TrackingSettings:
    """How closely the fingers follow the reference while holding (grasp-hump.md, grasp-own-motion.md).

    Attributes:
        quiet_rate: changes of the reference up to this are left to the loop's gain [N/s]: noise is not fed forward.
        near: the fingers rest within this share of the reference and noise: shaking makes fruit creep, and resting
            keeps the next command free.
        calm: errors within so many times the noise band are corrected with `calm_gain` [1/s]: their measurement is
            slow, and a larger gain makes the fingers swing.
        foreseen: faster motion than this is not relied upon before it shows [m/s]: fingers may be held up.
        too_much, too_little: of the noise band, so much is allowed where the force is too large, and where it is too
            small.
    """

    quiet_rate: float = 5.0
    near: float = 0.015
    calm: float = 4.0
    calm_gain: float = 3.0
    foreseen: float = 0.012
    too_much: float = 0.6
    too_little: float = 0.35


@dataclass(frozen=True, slots=True)
class CommandSettings:
    """When a rate of the fingers is commanded (grasp-command-timing.md).

    Attributes:
        keep_alive: a rate that goes on is commanded again this often, well within the driver's watchdog [s].
        heartbeat: rest is commanded again this often [s]: the driver's watchdog can but stop fingers that stand.
        trim: a rate that differs by less from the last one trims [m/s].
        hit_samples: the first samples of a push say too little: a rate waits until so many of them have come.
        calm_after: trims wait once there has been nothing else for so long [s]: in a lift every correction counts.
    """

    keep_alive: float = 0.06
    heartbeat: float = 0.5
    trim: float = 2e-3
    calm_after: float = 0.15
    hit_samples: int = 2


@dataclass(frozen=True, slots=True)
class WatchSettings:
    """What is found to be wrong, and when (grasp-bad-input.md, grasp-feel-friction.md).

    Attributes:
        contact: normal force of a finger that touches [N]; five times the noise of a slow finger.
        push_limit: a fruit may be pushed by one finger with at most this force until the other one touches [N].
        gone, gone_after: both fingers below this force [N] for so long [s]: the fruit is gone.
        dead, alive: a finger below this share of the other one, which feels more than the second [N], feels nothing
            any more.
        apart: while the pads slide, one finger may press with so much more than both shall together [N]: a fruit that
            stands on a table is held there, and pressed lightly it does not move to the middle between the fingers.
        saturated_after, stuck_after: how long a channel is at its end, and fingers stand, before it counts [s].
        beyond, beyond_after: a least force beyond this share of the measured one for so long [s] is slipping.
        slipping: slip is summed up while the least force is beyond this share of the measured one.
        stroke_end: so near to its end the gripper's stroke is used up [m].
    """

    contact: float = 0.4
    push_limit: float = 3.0
    gone: float = 0.15
    gone_after: float = 0.06
    dead: float = 0.25
    alive: float = 0.6
    apart: float = 1.2
    saturated_after: float = 0.05
    stuck_after: float = 0.5
    beyond: float = 1.02
    beyond_after: float = 0.3
    slipping: float = 0.95
    stroke_end: float = 0.0003


@dataclass(frozen=True, slots=True)
class SensorWatchSettings:
    """When a sensor is not believed any more (grasp-lying-sensors.md).

    Attributes:
        frozen_after: a noisy channel that repeats its value for so long [s] …
        fewest: … and so many samples is stuck,
        longer: unless it repeated a value a good part as long while the bias was taken: coarse steps do.
        jump: a signal of one finger alone that jumps by so much beyond noise while the fruit is carried [N].
        swinging: after a contact broke, no jump of one finger counts for so long [s]: the normal force's `normal_lag`.
        own_motion, own_motion_memory: of the fingers' own motion so many seconds' worth lately may show at once [s].
        apart, apart_share, apart_after: a fruit that hangs presses both fingers alike, but for so much [N] or this
            share of its load, whichever is more, for so long [s].
        hanging, load_memory: the load counts as hanging above this share of its largest one lately [s].
        motor_error, motor_share: what fingers feel and what the motor's current says may differ by so much [N] and
            this share. Twice the worst of sound simulated picks.
        motor_lag, motor_after: the motor's word is averaged over the first, and must differ for the second [s].
    """

    frozen_after: float = 0.02
    fewest: int = 5
    longer: float = 5.0
    jump: float = 0.4
    swinging: float = 0.06
    own_motion: float = 0.06
    own_motion_memory: float = 0.1
    apart: float = 0.5
    apart_share: float = 0.4
    apart_after: float = 0.04
    hanging: float = 0.7
    load_memory: float = 1.0
    motor_error: float = 1.5
    motor_share: float = 0.25
    motor_lag: float = 0.03
    motor_after: float = 0.02


@dataclass(frozen=True, slots=True)
class SlipWatchSettings:
    """When a fruit slides or turns whatever friction was told, and what follows (grasp-wrong-friction.md).

    Attributes:
        place_lags: the contact's place is averaged over these times; each is compared with the next longer one [s].
        moved: a place that moved by less is not slip [m]; pads and skin give by a tenth of a millimetre.
        moved_far: nor is a place that is still this near to where it was at first [m]; soft contacts give by 0.8 mm in
            MuJoCo's lifts.
        compliance: nor what pads and skin give for a load that changes [m/N].
        stds: nor is what so many standard deviations of noise can do.
        lever_lags: the lever is averaged over these times [s].
        lever_moved, lever_share, lever_stds: a lever that changed by less [m], by less than this share, or than so many
            standard deviations of noise can do, is no turning.
        lever_load: below this load [N] the lever is not known.
        lever_after: nor before the fruit has been carried for so long [s].
        least_share: what moves while it bears less than this share of what the friction told says is given to pads,
            skin or the table: friction told at most 1.67 times too high is found.
        sure_share: what slips beyond this share has the friction that was told.
    """

    place_lags: tuple[float, float, float] = (0.02, 0.1, 0.5)
    moved: float = 1.5e-4
    moved_far: float = 9e-4
    compliance: float = 4e-4
    stds: float = 5.5
    lever_lags: tuple[float, float] = (0.02, 0.3)
    lever_moved: float = 3e-4
    lever_share: float = 0.15
    lever_stds: float = 8.0
    lever_load: float = 0.3
    lever_after: float = 0.3
    least_share: float = 0.6
    sure_share: float = 0.9
