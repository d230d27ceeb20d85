"""The search for a cure: the run again, then one change at a time, then each success with other seeds."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from pomona.executive.execute import RunOrder
from pomona.executive.terminal.words import seconds
from pomona.tools.library.cures.candidates import CureCandidate
from pomona.tools.library.cures.change import SingleChange
from pomona.tools.library.cures.trials import OVER_BUDGET, Trial, TrialPool


@dataclass(slots=True)
class TriedChange:
    """A change that was tried; `others` are its repetitions with other seeds, by seed."""

    candidate: CureCandidate
    trial: Trial
    others: dict[int, Trial] = field(default_factory=dict)

    def successes(self) -> int:
        """Return the number of seeds with which it succeeded, the run's own included."""
        return self.trial.succeeded + sum(trial.succeeded for trial in self.others.values())


@dataclass(slots=True)
class CureAnswer:
    """The answer of a search.

    Attributes:
        seeds: the other seeds.
        original: the run again without a change; None if the budget ended before it.
        others: the same with the other seeds, until one fails: then chance alone is no cure.
        tried: every change that was tried, in the order in which the trials ended.
        untried: the number of candidates that were not tried.
        refused: the number that the check refused: nothing was run for them.
        spent: real time [s].
    """

    seeds: tuple[int, ...]
    original: Trial | None = None
    others: dict[int, Trial] = field(default_factory=dict)
    tried: list[TriedChange] = field(default_factory=list)
    untried: int = 0
    refused: int = 0
    spent: float = 0.0

    def sentence(self) -> str:
        """Return how much was tried; "no single change" is said only when nothing is left to try."""
        tried = (
            f"{len(self.tried)} changes tried in {seconds(self.spent)}, {self.untried} not tried"
        )
        if self.cures():
            return tried
        if self.untried:
            return f"no cure was found: {tried}; a longer `--budget` tries more"
        if not self.tried:
            return "no cure was found: there is no single change to try"
        return f"no single change of the tree or its cell cures it: {tried}"

    def cures(self) -> list[TriedChange]:
        """Return the changes that succeeded with every seed, the most likely and smallest first."""
        found = [tried for tried in self.tried if tried.successes() == 1 + len(self.seeds)]
        return sorted(
            found, key=lambda tried: (-tried.candidate.likely, tried.candidate.change.size)
        )

    def lucky(self) -> list[TriedChange]:
        """Return the changes that succeeded with the run's seed and are no cure."""
        return [t for t in self.tried if t.trial.succeeded and t.successes() <= len(self.seeds)]


@dataclass(frozen=True, slots=True)
class _Task:
    what: str  # original, change, seed, original seed
    seed: int
    candidate: CureCandidate | None = None
    tried: TriedChange | None = None


Progress = Callable[[str, CureCandidate | None, int, Trial], None]


@dataclass(slots=True, eq=False)
class CureSearch:
    """One search.

    Attributes:
        order: the run again.
        candidates: the most likely first.
        usable: whether a changed order passes the check; called before it is run.
        seeds: how many other seeds must succeed.
        most: the search ends with so many cures.
        budget: real time [s].
        progress: called with each end: `original`, `change` or `seed`, the candidate, the seed, the result.
        clock: real time [s].
    """

    order: RunOrder
    candidates: Sequence[CureCandidate]
    usable: Callable[[RunOrder], bool]
    seeds: int
    most: int
    budget: float
    progress: Progress = lambda _what, _candidate, _seed, _trial: None
    clock: Callable[[], float] = time.monotonic
    answer: CureAnswer = field(init=False)
    _urgent: deque[_Task] = field(default_factory=deque)
    _over: bool = False
    _compared: bool = False

    def run(self, trials: TrialPool) -> CureAnswer:
        """Search until there are enough cures, no candidate is left, or the budget is used."""
        begun = end = self.clock()
        # The budget begins when the run without a change has ended, and lets one change take twice as long.
        granted = 10.0 * self.budget
        self.answer = CureAnswer(tuple(self.order.seed + k for k in range(1, self.seeds + 1)))
        self._urgent.append(_Task("original", self.order.seed))
        left = iter(self.candidates)
        remaining = len(self.candidates)
        while (rest := max(end - self.clock(), granted)) > 0.0:
            while trials.free and (task := self._next(left)) is not None:
                remaining -= task.what == "change"
                trials.start(task, self._ordered(task), rest)
            ended = list(trials.ended())
            for task, trial in ended:
                granted = 0.0
                if trial.code == OVER_BUDGET:
                    remaining += task.what == "change"
                    continue
                self._take(task, trial)
                if task.what == "original":
                    end = self.clock() + self.budget
                    granted = 2.0 * (self.clock() - begun)
            if not ended or self._over:
                break
        self.answer.untried = remaining - self.answer.refused
        self.answer.spent = self.clock() - begun
        return self.answer

    def _ordered(self, task: _Task) -> RunOrder:
        order = replace(self.order, seed=task.seed)
        return order if task.candidate is None else task.candidate.change.applied(order)

    def _next(self, left: Iterator[CureCandidate]) -> _Task | None:
        while self._urgent:
            task = self._urgent.popleft()
            # after one failure the others of its kind would only count: a change is no cure, and chance is none
            of_task = self.answer.others if task.tried is None else task.tried.others
            if all(trial.succeeded for trial in of_task.values()):
                return task
        if len(self.answer.cures()) >= self.most:
            return None
        for candidate in left:
            if self._is_farther(candidate.change):
                continue
            if self.usable(candidate.change.applied(self.order)):
                return _Task("change", self.order.seed, candidate)
            self.answer.refused += 1
        return None

    def _may_be_smaller(self, task: _Task) -> bool:
        """Return whether a repetition is of a change that is smaller than the cure at the same place."""
        best = self.answer.cures()[0].candidate.change
        change = None if task.candidate is None else task.candidate.change
        return change is not None and _place(change) == _place(best) and change.size < best.size

    def _is_farther(self, change: SingleChange) -> bool:
        """Return whether a smaller change of the same place has succeeded with every seed so far."""
        good = (tried for tried in self.answer.tried if tried.successes() == 1 + len(tried.others))
        smaller = (one.candidate.change for one in good if one.candidate.change.size <= change.size)
        return any(_place(one) == _place(change) for one in smaller)

    def _take(self, task: _Task, trial: Trial) -> None:
        self.progress(task.what, task.candidate, task.seed, trial)
        answer = self.answer
        if task.what == "original":
            answer.original = trial
            self._over = trial.succeeded  # the failure does not repeat: there is nothing to cure
        elif task.what == "original seed":
            answer.others[task.seed] = trial
        elif task.what == "seed":
            assert task.tried is not None
            task.tried.others[task.seed] = trial
            if len(answer.cures()) == self.most and not self._compared:
                self._compared = True
                self._urgent = deque(filter(self._may_be_smaller, self._urgent))
                self._urgent.extend(_Task("original seed", seed) for seed in answer.seeds)
        else:
            assert task.candidate is not None
            tried = TriedChange(task.candidate, trial)
            answer.tried.append(tried)
            if trial.succeeded:
                self._urgent.extend(
                    _Task("seed", seed, task.candidate, tried) for seed in answer.seeds
                )


def _place(change: SingleChange) -> tuple[str, int, str]:
    return change.path, change.line, change.name
