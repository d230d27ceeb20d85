"""What a claim is, and how a driver is judged by it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from pomona.drivers.conformance.bench import Bench
from pomona.drivers.errors import DeviceError

B = TypeVar("B", bound=Bench)


class Finding(AssertionError):
    """A claim that a device does not keep, in one sentence."""


@dataclass(frozen=True, slots=True)
class Claim(Generic[B]):
    """A claim about devices of a kind.

    Attributes:
        name: by which a driver's class declares that it cannot keep it.
        words: the claim as a sentence.
        judge: opens benches by its argument, and raises Finding.
        essential: it cannot be declared away.
    """

    name: str
    words: str
    judge: Callable[[Callable[[], B]], None]
    essential: bool


@dataclass(frozen=True, slots=True)
class Claims(Generic[B]):
    """The claims of one kind of device."""

    kind: str
    all: list[Claim[B]] = field(default_factory=list)

    def claim(self, judge: Callable[[Callable[[], B]], None]) -> Callable[[Callable[[], B]], None]:
        """Add a claim: the first line of the function's docstring."""
        self._add(judge, essential=False)
        return judge

    def essential(
        self, judge: Callable[[Callable[[], B]], None]
    ) -> Callable[[Callable[[], B]], None]:
        """Add a claim that no driver can declare away."""
        self._add(judge, essential=True)
        return judge

    def _add(self, judge: Callable[[Callable[[], B]], None], *, essential: bool) -> None:
        words = (judge.__doc__ or "").partition("\n")[0].rstrip(".")
        self.all.append(Claim(judge.__name__, words, judge, essential))

    def tests(self, **benches: Callable[[], B]) -> Callable[..., None]:
        """Return a test for pytest of every claim, for each bench by its name."""
        import pytest

        cases = [
            pytest.param(opened, claim, id=f"{name}-{claim.name}")
            for name, opened in benches.items()
            for claim in self.all
        ]

        @pytest.mark.parametrize(("opened", "claim"), cases)
        def test_claim(opened: Callable[[], B], claim: Claim[B]) -> None:
            declared = judged(opened, claim)
            if declared:
                pytest.xfail(f"declared: {declared}")

        return test_claim


def judge_notice(opened: Callable[[], B], lasts: float) -> None:
    """Raise Finding: a harm of some length [s] is not reported until that is acknowledged, or does not pass."""
    for harm in opened().harms:
        bench = opened()
        bench.harm(harm, lasts)
        said = bench.problem()
        bench.heal()
        bench.serve(1.5)
        if not (said and bench.problem()):
            raise Finding(f"'{harm}' for {lasts:g} s: it says '{said}', then '{bench.problem()}'")
        with suppress(DeviceError):
            bench.device.acknowledge()
        bench.serve(0.5)
        seen = bench.device.last_seen()
        if bench.problem() or seen is None or bench.now - seen > 0.3:
            raise Finding(f"'{harm}', acknowledged: it says '{bench.problem()}', and is not there")


def judged(opened: Callable[[], B], claim: Claim[B]) -> str:
    """Judge a driver by a claim; return why it cannot keep it, if its class declares that, or an empty text.

    Raises Finding: it does not keep it, and does not declare that; it declares what cannot be declared away, or what it
    keeps after all.
    """
    device: Any = opened().device
    declared: str = device.declared.get(claim.name, "")
    if declared and claim.essential:
        raise Finding(f"{claim.words}: no driver can declare that it does not")
    try:
        claim.judge(opened)
    except Finding as finding:
        if declared:
            return declared
        raise Finding(f"{claim.words}: {finding}") from None
    if declared:
        raise Finding(f"{claim.words}: it does, though its class declares that it cannot")
    return ""
