"""Mode of the grip, and the reference of its force: a ramp to the initial force, then static plus dynamic term.

`ForceReference` is the grip's one state machine; `docs/architecture.md` has the diagram. Each mode of a held fruit is a
class with its law of the force and the transitions that it makes by itself. Its other transitions are calls: those of
the controller and of `Closing` before the fruit is held, and the request of a skill (`slide`).

f_ref = margin * f_ns + f_nd (the paper's eq. slip_avoidance_control_law), through a 50 Hz low-pass. The static part
rises with the load and falls slowly. Two more parts act for moments only, like the dynamic one: the rise of the load,
which continues until the fingers answer, and the lack of force near the limit surface, where a sliding fruit shows no
more than its friction.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import ClassVar

from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.grip import HANGING, HELD, GripMode
from pomona.skills.grip.limit_surface import least_force
from pomona.skills.grip.sensor import LowPass
from pomona.skills.grip.settings import ForceLaw, GripSettings


class Levels:
    """Parts of the reference that pass from mode to mode.

    Attributes:
        margin: factor on the minimum grip force, from the settings and the uncertainty of friction.
        bias_stds: standard deviations of the bias that are covered too.
        held: lasting part of the reference [N]: rises with the need, falls slowly.
        wanted: force that the load needs by the law of the mode [N].
        for_weight: force that it would need without its moment, as gripped at its centre [N].
        limit: upper bound of the reference [N].
        may_fall: False after doubt about the sensors.
        stands: True while the hand has not risen far enough for the fruit to hang.
    """

    def __init__(self, settings: GripSettings) -> None:
        self.set_friction(settings)
        self.held = self.wanted = self.for_weight = 0.0
        self.limit = math.inf
        self.may_fall = True
        self.stands = False
        self._urgent = LowPass(self.tuned.low_pass, 0.0)
        self._target = LowPass(self.tuned.excess_lag, 0.0)

    def set_friction(self, settings: GripSettings) -> None:
        """Take settings with another friction."""
        self.settings = settings
        self.tuned = settings.reference
        self.margin = max(
            settings.margin, self.tuned.least_margin * (1.0 + settings.mu_uncertainty)
        )
        self.bias_stds = self.tuned.bias_stds if self.margin > settings.margin else 0.0
        load = 0.5 * settings.expected_load
        self._for_expected_load = 2.0 * float(
            least_force(load, load * settings.offset, settings.contact)
        )

    def drop_urgent(self) -> None:
        """Forget the momentary part."""
        self._urgent.value = 0.0

    def raise_to_initial(self, elapsed: float) -> float:
        """Rise with `ramp_rate` to the initial force, and return the reference [N]."""
        self.held = min(self.held + self.settings.ramp_rate * elapsed, self.settings.initial_force)
        return self.held

    def follow(
        self,
        wanted: float,
        answer: float,
        elapsed: float,
        lowest: float = 0.0,
        fall_rate: float | None = None,
    ) -> float:
        """Follow a wanted force and a momentary answer, and return the reference [N].

        Args:
            wanted: lasting need [N]; a rise is followed at once.
            answer: momentary force on top of it [N].
            elapsed: time since the last call [s].
            lowest: the reference rises to this with `ramp_rate` even where less is wanted [N].
            fall_rate: of the lasting part [N/s]; None for `relaxation`.
        """
        s = self.settings
        self.wanted = wanted
        needed = max(wanted, s.floor)
        target = max(needed, lowest)
        self._target.update(target, elapsed)
        if target >= self.held:
            share = 1.0 - math.exp(-elapsed / self.tuned.low_pass)
            loaded = self.held + share * (max(needed, self.held) - self.held)
            rising = max(loaded, min(target, self.held + s.ramp_rate * elapsed))
            self.held = min(rising, max(self.held, self.limit))
        elif self.may_fall:
            self.held = max(target, self.held - (fall_rate or self.relaxation(target)) * elapsed)
        return self.held + self._urgent.update(answer, elapsed)

    def relaxation(self, target: float) -> float:
        """Rate at which the lasting part falls to a target [N/s]."""
        near = max(self.settings.relax_rate, self.tuned.relax_gain * (self.held - target))
        excess = self.held - self.tuned.excess * max(target, self._target.value)
        return near + self.tuned.excess_gain * max(excess, 0.0)

    def has_settled(self) -> bool:
        """Return True when the lasting part has come down to the wanted force."""
        return self.held <= max(self.wanted, self.settings.floor) * 1.05

    def baseline(self, estimate: GripEstimate) -> float | None:
        """Return the force by one of the laws for comparison [N], or None for slip avoidance."""
        match self.settings.law:
            case ForceLaw.CONSTANT:
                return self.settings.initial_force
            case ForceLaw.COULOMB:
                return self.margin * estimate.f_coulomb
            case ForceLaw.STATIC:
                return self.margin * estimate.f_least
        return None

    def is_pushed_off(self, estimate: GripEstimate) -> bool:
        """Return True when a push makes the fruit slide: friction then shows only the beginning of the push."""
        slides = estimate.push > 0.0 and estimate.f_least > self.tuned.sliding_ratio * estimate.f_n
        return slides and self.may_fall and self.settings.law is ForceLaw.SLIP_AVOIDANCE

    def answer(self, estimate: GripEstimate, force_coming: float) -> float:
        """Return the momentary force of slip avoidance [N]: dynamic term, rise of the load, and lack of force."""
        s = self.settings
        tuned = self.tuned
        missing = max(estimate.f_least - tuned.edge * force_coming - estimate.f_n_band, 0.0)
        coming = (
            tuned.lead
            * (1.0 + estimate.twist)
            * max(estimate.f_least_rise - estimate.f_n_band, 0.0)
        )
        if estimate.f_t < s.expected_load:
            coming = min(coming, max(self._for_expected_load - estimate.f_least, 0.0))
        # Force beyond the need is not added twice, except where the load twists: its moment is still to come.
        spare = max(1.0 - estimate.twist, 0.0) * max(
            force_coming - self.margin * estimate.f_least, 0.0
        )
        bound = tuned.most_doubtful
        if self.may_fall:
            bound = min(tuned.urgent_base + estimate.f_least, tuned.most_urgent)
        return min(estimate.f_nd + max(coming - spare, 0.0) + tuned.edge_gain * missing, bound)


class Mode(ABC):
    """Law of the force in one `GripMode` of a fruit in hand."""

    mode: ClassVar[GripMode]

    def __init__(self, levels: Levels) -> None:
        self._levels = levels

    @abstractmethod
    def follow(self, estimate: GripEstimate, force_coming: float, elapsed: float) -> float:
        """Return the reference after a sample [N]; the arguments are those of `ForceReference.follow`.

        The estimate has the load `f_t` and minimum forces [N]: `f_coulomb` (no moment), `f_least` (limit surface),
        `f_cautious` and `f_reserved` (with the reserve); `f_nd` answers slip, `push` is an impact.
        """

    def next_mode(self, estimate: GripEstimate) -> GripMode:
        """Return the mode for this estimate: by default this one, which only a request ends."""
        return self.mode


class StandingMode(Mode):
    """Until the tangential load changes by `load_changed`, the table carries the fruit: the initial force is enough."""

    mode = GripMode.STANDING
    _load = (0.0, 0.0)

    def start(self, load: tuple[float, float]) -> None:
        """Take the load of the standing fruit [N]."""
        self._load = load

    def follow(self, _estimate: GripEstimate, _force_coming: float, elapsed: float) -> float:
        self._levels.wanted = self._levels.settings.initial_force
        return self._levels.raise_to_initial(elapsed)

    def next_mode(self, estimate: GripEstimate) -> GripMode:
        change = math.hypot(estimate.load[0] - self._load[0], estimate.load[1] - self._load[1])
        return self.mode if change < self._levels.tuned.load_changed else GripMode.LIFTING


class LiftingMode(Mode):
    """The load comes on the fingers: at least the initial force, with the fruit's centre `offset` off the axis.

    The fruit is carried once the load has been steady for `carried_after`.
    """

    mode = GripMode.LIFTING
    _loaded_for = 0.0

    def follow(self, estimate: GripEstimate, force_coming: float, elapsed: float) -> float:
        levels = self._levels
        tuned = self._levels.tuned
        is_steady = (
            estimate.f_least_rise < tuned.carried_rise * estimate.f_least + estimate.f_n_band
        )
        if levels.stands or estimate.f_t < tuned.carried_load:
            self._loaded_for = 0.0
        elif is_steady:  # a rising load neither counts nor starts again
            self._loaded_for += elapsed
        wanted = levels.margin * estimate.f_cautious + levels.bias_stds * estimate.bias_std
        baseline = levels.baseline(estimate)
        answer = levels.answer(estimate, force_coming) if baseline is None else 0.0
        lowest = 0.0 if self._is_carried() else levels.settings.initial_force
        levels.for_weight = levels.margin * estimate.f_coulomb
        return levels.follow(wanted if baseline is None else baseline, answer, elapsed, lowest)

    def next_mode(self, _estimate: GripEstimate) -> GripMode:
        return GripMode.CARRIED if self._is_carried() else self.mode

    def _is_carried(self) -> bool:
        return self._loaded_for >= self._levels.tuned.carried_after


class CarriedMode(Mode):
    """The fruit hangs: the averaged minimum force with margin and reserve, and momentary answers to a rise."""

    mode = GripMode.CARRIED

    def __init__(self, levels: Levels) -> None:
        super().__init__(levels)
        tuned = levels.tuned
        self._steady = LowPass(tuned.rise_average)
        self._twist_fast, self._twist_slow = LowPass(tuned.creep_fast), LowPass(tuned.creep_slow)

    def follow(self, estimate: GripEstimate, force_coming: float, elapsed: float) -> float:
        levels = self._levels
        baseline = levels.baseline(estimate)
        levels.for_weight = levels.margin * estimate.f_coulomb
        if baseline is not None:
            return levels.follow(baseline, 0.0, elapsed)
        wanted = self._average(self._static(estimate), estimate, elapsed)
        return levels.follow(wanted, levels.answer(estimate, force_coming), elapsed)

    def next_mode(self, estimate: GripEstimate) -> GripMode:
        return GripMode.CATCHING if self._levels.is_pushed_off(estimate) else self.mode

    def _static(self, estimate: GripEstimate) -> float:
        levels = self._levels
        reserve = estimate.f_reserved - estimate.f_least
        uncertain = 1.0 + levels.settings.mu_uncertainty
        return (
            levels.margin * estimate.f_least
            + levels.tuned.reserve_margin * uncertain * reserve
            + levels.bias_stds * estimate.bias_std
        )

    def _average(self, static: float, estimate: GripEstimate, elapsed: float) -> float:
        """Return the static part without the noise of a light fruit [N]."""
        tuned = self._levels.tuned
        is_rising = math.isnan(self._steady.value) or static > self._steady.value
        steady = self._steady.update(
            static, elapsed, tuned.rise_average if is_rising else tuned.fall_average
        )
        creep = tuned.creep_gain * self._creep(estimate, elapsed) * estimate.f_coulomb
        noise = tuned.average_stds * self._levels.margin * estimate.f_least_std
        return steady + max(static - steady - noise, 0.0) + creep

    def _creep(self, estimate: GripEstimate, elapsed: float) -> float:
        """Return the growth of the ratio of minimum force to Coulomb's force, beyond noise."""
        ratio = estimate.f_least / max(estimate.f_coulomb, 0.1)
        fast = self._twist_fast.update(ratio, elapsed)
        slow = self._twist_slow.update(ratio, elapsed)
        return max(fast - slow - self._levels.tuned.creep_noise, 0.0)


class CatchingMode(Mode):
    """A push makes the carried fruit slide: the force rises as long as it slides, and falls to `floor` after the push.

    Doubt about the sensors ends it.
    """

    mode = GripMode.CATCHING

    def __init__(self, levels: Levels, carried: CarriedMode) -> None:
        super().__init__(levels)
        self._carried = carried
        self._caught = 0.0

    def follow(self, estimate: GripEstimate, force_coming: float, elapsed: float) -> float:
        f_ref = self._carried.follow(estimate, force_coming, elapsed)
        tuned = self._levels.tuned
        if self._levels.is_pushed_off(estimate):
            more = min(
                tuned.push_gain * estimate.push / self._levels.settings.contact.mu,
                tuned.most_urgent,
            )
            self._caught = max(self._caught, estimate.f_n + more)
        elif estimate.push == 0.0:
            self._caught -= min(tuned.excess_gain * elapsed, 1.0) * self._caught
        return max(f_ref, self._caught)

    def next_mode(self, estimate: GripEstimate) -> GripMode:
        levels = self._levels
        if levels.may_fall and (
            self._caught > levels.settings.floor or levels.is_pushed_off(estimate)
        ):
            return self.mode
        self._caught = 0.0
        return GripMode.CARRIED


class SlidingMode(Mode):
    """The skill's force under any load: it rises with `sliding_rate` and falls as in the other modes."""

    mode = GripMode.SLIDING
    force = 0.0

    def follow(self, _estimate: GripEstimate, _force_coming: float, elapsed: float) -> float:
        levels = self._levels
        force = self.force
        levels.wanted = force
        levels.drop_urgent()
        lowest = levels.held - levels.relaxation(force) * elapsed
        levels.held = max(lowest, min(force, levels.held + levels.tuned.sliding_rate * elapsed))
        return levels.held


def usual_modes(levels: Levels) -> tuple[Mode, ...]:
    """Return the law of the grip force in each mode of a fruit that is lifted or carried."""
    carried = CarriedMode(levels)
    return LiftingMode(levels), carried, CatchingMode(levels, carried)


class ForceReference:
    """Mode of the grip, and the force to track in it; of two `modes` with the same `mode` the later one counts.

    Attributes:
        mode: of the grip.
        f_ref: the reference [N].
        frozen: reason why the reference may not fall any more; empty while it may.
    """

    def __init__(
        self, settings: GripSettings, modes: Callable[[Levels], Iterable[Mode]] = usual_modes
    ) -> None:
        self.f_ref = 0.0
        self.mode = GripMode.BIAS
        self.frozen = ""
        self._levels = levels = Levels(settings)
        self._standing, self._sliding = StandingMode(levels), SlidingMode(levels)
        laws = (self._standing, self._sliding, *modes(levels))
        self._modes: dict[GripMode, Mode] = {law.mode: law for law in laws}
        self._resumed = GripMode.LIFTING

    @property
    def wanted(self) -> float:
        """Force that the load needs by the law of the mode [N]."""
        return self._levels.wanted

    @property
    def for_weight(self) -> float:
        """Force that the load would need without its moment, as gripped at its centre [N]."""
        return self._levels.for_weight

    @property
    def is_carried(self) -> bool:
        """True for a fruit that hangs in the fingers."""
        return (self._resumed if self.mode is GripMode.SLIDING else self.mode) in HANGING

    @property
    def has_settled(self) -> bool:
        """True when the lasting part has come down to the wanted force."""
        return self._levels.has_settled()

    def set_friction(self, settings: GripSettings) -> None:
        """Take settings with another friction."""
        self._levels.set_friction(settings)

    def close(self) -> None:
        """Close on the fruit."""
        self.mode = GripMode.CLOSING

    def fail(self) -> None:
        """End before the fruit is held."""
        self.mode = GripMode.FAILED

    def begin(self, f_n: float) -> None:
        """Begin the ramp with the force at contact [N]."""
        self.mode = GripMode.RAMP
        self.f_ref = self._levels.held = min(max(f_n, 0.0), self._levels.settings.initial_force)

    def ramp(self, elapsed: float) -> float:
        """Rise towards the initial force, and return the reference [N]."""
        self.f_ref = self._levels.raise_to_initial(elapsed)
        return self.f_ref

    def stand(self, load: tuple[float, float]) -> None:
        """Hold a fruit that stands under a tangential load [N]."""
        self.mode = GripMode.STANDING
        self._standing.start(load)

    def slide(self, force: float | None) -> bool:
        """Keep this grip force [N] under any load, or resume the mode before; False in a mode that refuses it."""
        if force is not None:
            self._sliding.force = force
        if self.mode in HELD:
            self._resumed = self.mode
        elif self.mode is not GripMode.SLIDING:
            return False
        self.mode = self._resumed if force is None else GripMode.SLIDING
        return True

    def stand_until_lifted(self, stands: bool) -> None:
        """Count no load as that of a hanging fruit while it `stands`: pads that have slid keep some."""
        self._levels.stands = stands

    def freeze(self, reason: str) -> None:
        """Never lower the reference again; the first reason is kept."""
        self.frozen = self.frozen or reason
        self._levels.may_fall = False

    def distrust(self, reason: str) -> None:
        """Freeze, and rise no further than to a multiple of the force until now."""
        levels = self._levels
        if not math.isfinite(levels.limit):
            levels.limit = levels.tuned.fault_ratio * max(self.f_ref, levels.settings.floor)
        self.freeze(reason)

    def follow(self, estimate: GripEstimate, force_coming: float, elapsed: float) -> None:
        """Follow the law of the mode for `elapsed` seconds.

        Args:
            estimate: after the newest sample.
            force_coming: sum of both fingers' forces once the commanded motion has taken effect [N].
            elapsed: time since the last call [s].
        """
        self.mode = self._modes[self.mode].next_mode(estimate)
        law = self._modes[self.mode]
        f_ref = law.follow(estimate, force_coming, elapsed)
        self.mode = law.next_mode(estimate)
        self.f_ref = min(f_ref, self._levels.limit, self._levels.settings.loop.max_force)
