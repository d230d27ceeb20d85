"""What the fingers say about the grasp: loads, the least force that holds them, and the estimated slip.

Bias, filters, limit surface, observer and dynamic term in one compiled step per sample.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from skills.grip.dynamic_term import DynamicSettings, answer_slip
from skills.grip.grip import Float64
from skills.grip.limit_surface import SoftContact, least_force_of_finger, surface_table
from skills.grip.observer import STEP, ObserverSettings, observe
from skills.grip.pads import MIRROR, PRESSING, loads_of_finger, smooth

FAST, SLOW_NORMAL, SLOW_LOAD = 0.005, 0.06, 0.08
"""Time constants of the filters [s]."""

RISE_LAG = 0.03
"""The rise of the least force is what it is beyond itself through a low-pass of this time constant [s]."""

NOISE_SHARE = 2.5
"""The fast filter counts where it differs from the slow one by so many of its standard deviations."""

FARTHEST_CENTRE = 0.02
"""The centre of rotation is taken to be at most so far away [m]; a fruit that only translates has it at infinity."""

CENTRE_LAG = 0.1
"""Time constant with which the estimated centre of rotation moves [s]."""

TWIST_BOUND = 2.0
"""A twist beyond this counts as this much."""

JUMP = 0.4
"""A force that changes on one finger alone by so much more than noise at once is no load [N]."""

QUIET = 0.05
"""What is beyond noise by less than this is still noise [N]."""

_MEMORY = 6  # omega, z, integral of C_d, omega before, centre, warm
_SENSED = 17


@njit(cache=True)
def _sense(  # type: ignore[no-untyped-def]
    raw, periods, expected, bias, mirror, noise, variance, fast, slow, smoothed, shares, centre_share, contact, f, tau,
    load, observer, dynamic, memory, sensed,
):  # fmt: skip
    mu, torsion, gamma, delta, ellipsoid, offset_unknown, reserve = contact
    sigma0, beta, inertia, mass, offset, gain = observer
    kp, ki, kdc, bound = dynamic
    for _ in range(periods):
        smooth(raw, bias, mirror, noise, fast, slow, smoothed, shares, expected)
    least = 0.0
    coulomb = 0.0
    reserved = 0.0
    cautious = 0.0
    centre = 0.0
    g_torque = 0.0
    g_force = 0.0
    y_torque = 0.0
    y_force = 0.0
    across_x = 0.0
    across_y = 0.0
    blur = 0.0
    for i in range(2):
        f_n, f_x, f_y, tau_n = loads_of_finger(smoothed[i])
        # Noise makes magnitudes larger than they are: what it adds to their squares is taken off.
        f_t = math.sqrt(max(f_x * f_x + f_y * f_y - variance[0] - variance[1], 0.0))
        lever = f_t / max(f_n, PRESSING)
        tau_variance = variance[5] + lever * lever * variance[4]
        tau_n = math.copysign(math.sqrt(max(tau_n * tau_n - tau_variance, 0.0)), tau_n)
        needed, s = least_force_of_finger(f_t, tau_n, mu, torsion, gamma, f, tau, load)
        by_force = least_force_of_finger(f_t + math.sqrt(variance[0]), tau_n, mu, torsion, gamma, f, tau, load)[0]
        by_moment = least_force_of_finger(f_t, abs(tau_n) + math.sqrt(tau_variance), mu, torsion, gamma, f, tau, load)[
            0
        ]
        blur += (by_force - needed) ** 2 + (by_moment - needed) ** 2
        least += needed
        coulomb += f_t / mu
        f_t_feared = f_t + 0.5 * reserve
        tau_pushed = abs(tau_n) * f_t_feared / max(f_t, 0.1)
        reserved += least_force_of_finger(f_t_feared, tau_pushed, mu, torsion, gamma, f, tau, load)[0]
        tau_feared = max(abs(tau_n), f_t * offset_unknown)
        cautious += least_force_of_finger(f_t_feared, tau_feared, mu, torsion, gamma, f, tau, load)[0]
        pressing = max(f_n, 0.05)
        u = s * (f.size - 1)
        j = min(int(u), f.size - 2)
        f_tilde = f[j] + (u - j) * (f[j + 1] - f[j])
        tau_tilde = tau[j] + (u - j) * (tau[j + 1] - tau[j])
        if s >= 1.0:
            c = FARTHEST_CENTRE
        elif ellipsoid > 0.0:
            c = torsion * pressing**gamma / mu * math.tan(0.5 * math.pi * s)
        else:
            c = delta * pressing**gamma * s / (1.0 - s)
        centre += 0.5 * min(c, FARTHEST_CENTRE)
        g_torque += torsion * pressing ** (gamma + 1.0) * tau_tilde
        g_force += mu * pressing * f_tilde
        y_torque += abs(tau_n)
        y_force += f_t
        across_x += f_x
        across_y += f_y
        sensed[i] = f_n
        sensed[2 + i] = tau_n
    omega, z, integral, before, c, warm = memory[0], memory[1], memory[2], memory[3], memory[4], memory[5]
    if warm == 0.0:
        c = centre
    else:
        c += min(periods * centre_share, 1.0) * (centre - c)
    y = y_torque + c * y_force
    g = g_torque + c * g_force
    if warm == 0.0:
        omega, z, integral, before = 0.0, y / sigma0, 0.0, 0.0
    J = inertia + mass * (c + offset) ** 2
    f_nd = 0.0
    for _ in range(periods * 4):
        omega, z = observe(omega, z, y, g, J, sigma0, beta, gain)
        integral, f_nd = answer_slip(integral, before, omega, kp, ki, kdc, bound)
        before = omega
    memory[0], memory[1], memory[2], memory[3], memory[4], memory[5] = omega, z, integral, before, c, 1.0
    sensed[4] = least
    sensed[5] = coulomb
    sensed[6] = f_nd
    sensed[7] = omega
    sensed[8] = c
    sensed[9] = math.hypot(across_x, across_y)
    sensed[10] = y
    sensed[11] = g
    sensed[13] = cautious
    sensed[15] = reserved
    sensed[16] = math.sqrt(blur)
    sensed[14] = 2.0 * (abs(fast[1, 2] - slow[1, 2]) - noise[1, 2])
    sensed[12] = _jump_of_one_finger(fast, slow, noise)


@njit(cache=True)
def _jump_of_one_finger(fast, slow, noise):  # type: ignore[no-untyped-def]
    """How far one finger's tangential force has jumped beyond noise while the other feels nothing at all [N]."""
    result = 0.0
    for finger in range(2):
        sign = 1.0 if finger == 0 else -1.0
        jumped = 0.0
        other = 0.0
        for j in range(3):
            alike, apart = fast[0, j] - slow[0, j], fast[1, j] - slow[1, j]
            beyond = noise[0, j] + noise[1, j]
            if j < 2:
                jumped = max(jumped, abs(alike + sign * apart) - beyond)
            other = max(other, abs(alike - sign * apart) - beyond)
        if other <= QUIET:
            result = max(result, jumped)
    return result


class SlipSense:
    """Senses loads and slip, sample by sample. Usable alone: `settle` the bias, then `advance` with raw wrenches.

    After `advance`: `fingers` (pressing forces, shape (2,) [N]), `f_n` (grasp force [N]), `least` (least grasp force by
    the limit surface, without margin [N]), `coulomb` (the same by Coulomb's law), `f_nd` (dynamic term [N]), `omega`
    (estimated slip velocity [rad/s]), `centre` (its distance from the contact [m]), `f_t` [N] and `tau_n` [N·m] of both
    fingers together.
    """

    def __init__(
        self,
        contact: SoftContact,
        observer: ObserverSettings,
        dynamic: DynamicSettings,
        rate: float = 500.0,
        offset: float = 0.0,
        reserve: float = 0.0,
    ) -> None:
        if round(1.0 / (rate * STEP)) != 4:
            raise ValueError(f"the observer's step fits a sensor of 500 Hz, not one of {rate:g} Hz")
        self._unknown = (offset, reserve)
        self.know(contact)
        self._observer = (
            observer.sigma0, observer.beta, observer.inertia, observer.mass, observer.offset, observer.gain
        )  # fmt: skip
        self._dynamic = (dynamic.kp, dynamic.ki, dynamic.kdc, dynamic.bound)
        self._shares = tuple(
            1.0 - math.exp(-1.0 / (rate * lag)) for lag in (FAST, SLOW_NORMAL, SLOW_LOAD, CENTRE_LAG, RISE_LAG)
        )
        self._bias, self._noise, self._variance = np.zeros((2, 6)), np.zeros((2, 6)), np.zeros(6)
        self._fast, self._slow, self._smoothed = np.zeros((2, 6)), np.zeros((2, 6)), np.zeros((2, 6))
        self._memory, self._sensed = np.zeros(_MEMORY), np.zeros(_SENSED)
        # One finger's normal force has just changed alone: the larger one counts meanwhile.
        self.one_sided_press = False
        self._least_before = self._unrest = self._doubt = self._difference_variance = 0.0
        self.f_n = self.least = self.coulomb = self.f_nd = self.omega = self.centre = self.f_t = self.tau_n = 0.0

    def know(self, contact: SoftContact) -> None:
        """Take another friction from the next sample on."""
        table = surface_table(contact)
        self._table = (table.f, table.tau, table.load)
        self._contact = (
            contact.mu, contact.torsion, contact.gamma, contact.delta, float(contact.ellipsoid), *self._unknown
        )  # fmt: skip

    @property
    def bias(self) -> Float64:
        """What the fingers show with nothing between them, shape (2, 6)."""
        return self._bias.copy()

    @property
    def fingers(self) -> tuple[float, float]:
        return float(self._sensed[0]), float(self._sensed[1])

    @property
    def rise(self) -> float:
        """How much the least force has risen just now [N]; negative while it falls."""
        return self.least - self._least_before

    @property
    def twist(self) -> float:
        """How much more force the moment asks for than the weight alone, as a share of that; 0 … `TWIST_BOUND`."""
        return min(max(self.least / max(self.coulomb, 0.1) - 1.0, 0.0), TWIST_BOUND)

    @property
    def one_sided_jump(self) -> bool:
        """Whether one finger's tangential force has just jumped and the other's has not: no fruit does that."""
        return bool(self._sensed[12] > JUMP)

    @property
    def reserved(self) -> float:
        """The least force for the measured load and a push of the reserve on the same lever [N]."""
        return float(self._sensed[15])

    @property
    def blur(self) -> float:
        """Standard deviation of what noise alone puts on the least force [N]."""
        return float(self._sensed[16])

    @property
    def cautious(self) -> float:
        """The least force if the fruit's centre lay `offset` off the grasp axis, or as measured if that is more [N]."""
        return float(self._sensed[13])

    @property
    def unrest(self) -> float:
        """How far noise alone carries the measured grasp force from the true one, twice its standard deviation [N]."""
        return self._unrest

    @property
    def doubt(self) -> float:
        """Standard deviation of the error that the bias, itself a mean of noise, puts on the least force [N]."""
        return self._doubt

    def settle(self, samples: Float64) -> None:
        """Take the bias, and how noisy the fingers are, from samples with nothing touching, shape (n, 2, 6)."""
        self._bias[:] = samples.mean(axis=0)
        fast_share = self._shares[0]
        second = MIRROR * samples[:, 1]
        modes = 0.5 * np.stack([samples[:, 0] + second, samples[:, 0] - second], axis=1)
        self._noise[:] = NOISE_SHARE * modes.std(axis=0) * math.sqrt(fast_share / (2.0 - fast_share))
        slow_share = self._shares[2]
        self._variance[:] = modes.var(axis=0).sum(axis=0) * slow_share / (2.0 - slow_share)
        normal_share = self._shares[1]
        apart = float(modes[:, 1, 2].var()) * normal_share / (2.0 - normal_share)
        self._difference_variance = 4.0 * apart
        mean_of = samples.var(axis=0).sum(axis=0) / len(samples)
        self._doubt = math.sqrt(float(mean_of[2] + 0.5 * (mean_of[0] + mean_of[1]) / self._contact[0] ** 2))
        self._unrest = 4.0 * math.sqrt(float(modes[:, :, 2].var(axis=0).sum()) * normal_share / (2.0 - normal_share))
        for state in (self._fast, self._slow, self._smoothed, self._memory):
            state[:] = 0.0

    def start_observer(self) -> None:
        """Start the observer at rest under the load that the next sample shows."""
        self._memory[5] = 0.0

    def advance(self, raw: Float64, periods: int = 1, expected: float = 0.0) -> None:
        """Take one raw sample, shape (2, 6), that stands for so many periods.

        In each of them the fingers' own motion is expected to change the grasp force by `expected` [N].
        """
        _sense(
            raw, periods, expected, self._bias, MIRROR, self._noise, self._variance, self._fast, self._slow,
            self._smoothed, self._shares[:3], self._shares[3], self._contact, *self._table, self._observer,
            self._dynamic, self._memory, self._sensed,
        )  # fmt: skip
        first, second, tau_0, tau_1, self.least, self.coulomb, self.f_nd, self.omega, self.centre, self.f_t = (
            self._sensed[:10].tolist()
        )
        self.one_sided_press = self._sensed[14] > JUMP
        difference = math.sqrt(max((first - second) ** 2 - self._difference_variance, 0.0))
        self.f_n = max(first + second + (difference if self.one_sided_press else -difference), 0.0)
        self.tau_n = tau_0 + tau_1
        self._least_before += min(periods * self._shares[4], 1.0) * (self.least - self._least_before)
