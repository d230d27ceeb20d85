"""Candidates of a cure: values, remedies, orders, the search. Nothing runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pomona.executive.execute import RunOrder
from pomona.executive.language import read
from pomona.executive.language.check import analyse
from pomona.executive.ports import LENGTH, RATIO, TIME, Port
from pomona.executive.reasons import Reason
from pomona.executive.registry import Registry
from pomona.executive.running.events import AttemptEnded, NodeChanged, RunEnded
from pomona.executive.values.documents import Option
from pomona.tools.library.cures.candidates import CureCandidate, candidates, hints
from pomona.tools.library.cures.change import SingleChange
from pomona.tools.library.cures.evidence import RunEvidence, gather
from pomona.tools.library.cures.knobs import Knobs
from pomona.tools.library.cures.other_values import other_values
from pomona.tools.library.cures.search import CureSearch
from pomona.tools.library.cures.trials import OVER_BUDGET, Trial

# ------------------------------------------------------------------------------------------------ values


def texts(*about: Any, **more: Any) -> list[str]:
    return [
        other.text for other in sorted(other_values(*about, **more), key=lambda other: -other.share)
    ]


def test_numbers_keep_their_unit_and_their_bounds() -> None:
    assert texts("2 s", Port(TIME), direction=1)[:3] == ["4 s", "10 s", "50 s"]
    assert texts("20 mm", Port(LENGTH, min="8 mm"), direction=-1)[:2] == ["10 mm", "8 mm"]
    assert texts("0.6", Port(RATIO, min=0, max=1), direction=1)[0] == "1"


def test_a_default_comes_before_other_values_unless_a_remedy_says_the_other_direction() -> None:
    assert texts("20 mm", Port(LENGTH), "12 cm")[0] == "12 cm"
    assert texts("20 mm", Port(LENGTH), "12 cm", -1)[0] == "10 mm"


def test_whole_numbers_stay_whole_and_positive() -> None:
    assert texts("3", Port(int, min=1)) == ["6", "1", "15", "75"]
    assert texts("1", Port(object)) == ["2", "5", "25"]


def test_words_have_their_choices_and_a_range_of_an_option_is_left_alone() -> None:
    assert texts("paper", Port(str, choices=("shape", "paper", "none"))) == ["shape", "none"]
    assert texts("true", Port(bool)) == ["false"]
    assert texts("0.95..1.10", Port(object), "0.95..1.10") == []
    assert texts("0", Port(int)) == []


def test_remedies_name_ports_and_directions() -> None:
    found = {name: hint.direction for name, hint in hints("NO_PATH").items()}
    assert found == {"budget": 1, "clearance": -1}
    assert hints("SLIPPED")["margin"].direction == 1
    assert hints("NO_SUCH_CODE") == {}


# ------------------------------------------------------------------------------------------------ candidates

TREE = """\
pomona: 1
tree: t
parameters:
  least: {type: int, default: 5}
  other: {type: int, default: 7}
root:
  sequence:
    - set: {got: 3}
      name: Measure
    - check: "{got} >= {least}"
      name: Enough
    - wait: "{pause}"
      name: After
  retry: 2
constants: {pause: 20 ms}
"""


def found(
    tree: str, code: str, path: str, *more: Any, settings: dict[str, str] | None = None
) -> list[CureCandidate]:
    from recorded_events import started

    document = read(tree, "t.yaml")
    analysis = analyse(document, Registry({}), overrides=settings or {})
    assert not analysis.errors, analysis.errors
    from pomona.executive.language.build import build
    from pomona.executive.skill_testing import BenchContext

    nodes = build(document, Registry({}), context=BenchContext(), overrides=settings or {}).nodes
    reason = Reason(path, code, "it failed")
    events = [
        started(nodes=tuple(node.facts() for node in nodes), tree_path="t.yaml", tree_text=tree),
        NodeChanged(0.1, 1, path, "FAILURE", "", 1, reason),
        *more,
        RunEnded(
            1.0, 9, "failure", Reason("t", code, "it failed", causes=(reason,)), 9, 1.0, 1.0, None
        ),
    ]
    return candidates(Knobs(analysis, settings or {}), gather(events))


def test_what_a_failed_condition_reads_comes_before_unrelated_parameters() -> None:
    names = [candidate.change.name for candidate in found(TREE, "CONDITION_FALSE", "t/Enough")]
    assert names[0] == "least"
    assert names.index("Measure.got") < names.index("other")
    assert "pause" not in names  # the node that reads it has not run


def test_a_value_with_which_the_run_was_started_comes_first() -> None:
    first = found(TREE, "CONDITION_FALSE", "t/Enough", settings={"least": "50", "other": "9"})[
        0
    ].change
    assert (first.name, first.after, first.line) == ("least", "5", 4)


def test_tries_that_were_used_up_are_a_candidate_and_others_are_not() -> None:
    used = AttemptEnded(0.9, 8, "t:retry", 2, 2, False)
    names = [c.change.name for c in found(TREE, "CONDITION_FALSE", "t/Enough", used)]
    assert "t.retry" in names or "sequence.retry" in names


def test_each_candidate_is_one_change_and_the_list_is_sorted() -> None:
    every = found(TREE, "CONDITION_FALSE", "t/Enough")
    assert len({c.change.sentence for c in every}) == len(every)
    assert [c.likely for c in every] == sorted((c.likely for c in every), reverse=True)
    assert all((not c.change.settings) != (c.change.piece is None) for c in every)


def test_no_failure_gives_no_candidate_of_a_node() -> None:
    analysis = analyse(read(TREE, "t.yaml"), Registry({}))
    assert {c.change.kind for c in candidates(Knobs(analysis, {}), RunEvidence())} <= {"parameter"}


# ------------------------------------------------------------------------------------------------ the search


class Scripted:
    """Trials whose results a function gives, two at once; they end in the order in which they were started."""

    def __init__(self, result: Any) -> None:
        self.result, self.started, self.waiting = result, [], []

    @property
    def free(self) -> bool:
        return len(self.waiting) < 2

    def start(self, key: Any, order: RunOrder, limit: float) -> None:
        self.started.append((order.settings.get("n", ""), order.seed))
        self.waiting.append((key, order))

    def ended(self) -> Iterator[tuple[Any, Trial]]:
        if self.waiting:
            key, order = self.waiting.pop(0)
            good = self.result(order.settings.get("n", ""), order.seed)
            yield key, Trial("success" if good else "failure", "" if good else "NO_PATH", time=1.0)


def search(result: Any, count: int = 4, **more: Any) -> tuple[Any, Scripted]:
    order = RunOrder(Path("t.yaml"), Path("c.yaml"), seed=7)
    every = [
        CureCandidate(
            SingleChange("parameter", "n", "t.yaml", 4, "0", str(n), 1.0, {"n": str(n)}),
            1.0 / n,
            "",
        )
        for n in range(1, count + 1)
    ]
    about = {
        "usable": lambda _order: True,
        "seeds": 2,
        "most": 1,
        "budget": 60.0,
        "clock": lambda: 0.0,
    } | more
    trials = Scripted(result)
    return CureSearch(order, every, **about).run(trials), trials


def test_a_success_is_repeated_with_other_seeds_before_the_next_candidate_is_tried() -> None:
    answer, trials = search(lambda n, seed: n == "1")
    assert trials.started[:2] == [("", 7), ("1", 7)]
    assert ("1", 8) in trials.started
    assert ("1", 9) in trials.started
    assert [tried.candidate.change.after for tried in answer.cures()] == ["1"]
    assert answer.lucky() == []


def test_a_change_that_fails_with_another_seed_is_no_cure() -> None:
    answer, _ = search(lambda n, seed: (n == "1" and seed != 8) or n == "3")
    assert [tried.candidate.change.after for tried in answer.cures()] == ["3"]
    assert [tried.candidate.change.after for tried in answer.lucky()] == ["1"]


def test_no_larger_change_of_a_place_is_tried_while_a_smaller_one_succeeds() -> None:
    order = RunOrder(Path("t.yaml"), Path("c.yaml"), seed=7)
    steps = [
        SingleChange("parameter", "n", "t.yaml", 4, "0", str(n), float(n), {"n": str(n)})
        for n in (2, 4, 8)
    ]
    other = SingleChange("parameter", "m", "t.yaml", 5, "0", "1", 1.0, {"n": "m"})
    every = [CureCandidate(change, 1.0, "") for change in (*steps, other)]
    trials = Scripted(lambda n, seed: n == "2")
    answer = CureSearch(order, every, lambda _order: True, 1, 1, 60.0, clock=lambda: 0.0).run(
        trials
    )
    assert {n for n, _ in trials.started} <= {"", "2", "4", "m"}  # the 4 was started beside the 2
    assert len(answer.cures()) == 1


def test_the_original_is_repeated_with_the_seeds_of_the_cure() -> None:
    answer, _ = search(lambda n, seed: n == "1" or seed == 8)
    assert {seed: trial.succeeded for seed, trial in answer.others.items()} == {8: True, 9: False}


def test_the_original_is_not_repeated_after_a_failure_with_another_seed() -> None:
    answer, trials = search(lambda n, seed: n == "1", seeds=5)
    assert answer.cures()[0].successes() == 6
    assert [seed for n, seed in trials.started if n == ""] == [
        7,
        8,
        9,
    ]  # two were running when the first one failed


def test_a_failure_that_does_not_repeat_ends_the_search() -> None:
    answer, trials = search(lambda n, seed: n == "")
    assert answer.original.succeeded
    assert len(trials.started) == 2  # the second was started beside it


def test_no_candidate_is_tried_after_the_budget() -> None:
    times = iter(float(t) for t in range(0, 1000, 25))
    answer, trials = search(lambda n, seed: False, 40, clock=lambda: next(times))
    assert answer.cures() == []
    assert len(trials.started) <= 5
    assert answer.untried >= 35


def test_the_run_without_a_change_takes_nothing_of_the_budget_and_one_change_is_tried() -> None:
    times = iter([0.0, 0.0, 50.0, 50.0, *(float(t) for t in range(50, 100))])
    limits: list[float] = []

    class Alone(Scripted):
        @property
        def free(self) -> bool:
            return not self.waiting

        def start(self, key: Any, order: RunOrder, limit: float) -> None:
            limits.append(limit)
            super().start(key, order, limit)

    order = RunOrder(Path("t.yaml"), Path("c.yaml"), seed=7)
    change = SingleChange("parameter", "n", "t.yaml", 4, "0", "1", 1.0, {"n": "1"})
    every = [CureCandidate(change, 1.0, ""), CureCandidate(change, 0.5, "")]
    answer = CureSearch(
        order, every, lambda _order: True, 2, 1, 1e-3, clock=lambda: next(times)
    ).run(Alone(lambda n, seed: False))
    assert limits == [0.01, 100.0]  # the run took 50 s: its first change may take twice as long
    assert (len(answer.tried), answer.untried) == (1, 1)
    assert answer.sentence().startswith("no cure was found: 1 changes tried in ")


def test_no_change_cures_it_is_said_only_after_all_were_tried() -> None:
    complete, _ = search(lambda n, seed: False)
    assert complete.sentence().startswith("no single change of the tree or its cell cures it: 4 ")
    none, _ = search(lambda n, seed: False, count=0)
    assert none.sentence() == "no cure was found: there is no single change to try"
    cured, _ = search(lambda n, seed: n == "2")
    assert cured.sentence().startswith("3 changes tried")


def test_a_repetition_that_the_budget_cuts_off_is_no_result() -> None:
    class Cut(Scripted):
        def ended(self) -> Iterator[tuple[Any, Trial]]:
            for key, _ in self.waiting:
                yield key, Trial("lost", OVER_BUDGET)
            self.waiting = []

    order = RunOrder(Path("t.yaml"), Path("c.yaml"), seed=7)
    change = SingleChange("parameter", "n", "t.yaml", 4, "0", "1", 1.0, {"n": "1"})
    shown: list[Any] = []
    times = iter((0.0, 0.5, 2.0, 2.0))
    answer = CureSearch(
        order, [CureCandidate(change, 1.0, "")], lambda _order: True, 2, 1, 1.0, lambda *each: shown.append(each),
        clock=lambda: next(times),
    ).run(Cut(lambda n, seed: False))  # fmt: skip
    assert (answer.original, answer.tried, answer.untried, shown) == (None, [], 1, [])


def test_a_change_that_the_check_refuses_is_not_run() -> None:
    answer, trials = search(lambda n, seed: False, usable=lambda order: order.settings["n"] == "2")
    assert [n for n, _ in trials.started] == ["", "2"]
    assert (answer.refused, answer.untried) == (3, 0)


def test_the_original_is_repeated_once_with_each_seed_though_another_change_ends_later() -> None:
    _, trials = search(lambda n, seed: n == "1" or (n == "2" and seed != 9))
    assert sorted(seed for n, seed in trials.started if n == "") == [7, 8, 9]


def test_of_two_changes_of_a_place_that_cure_the_smaller_one_is_the_answer() -> None:
    order = RunOrder(Path("t.yaml"), Path("c.yaml"), seed=7)
    steps = [
        SingleChange("parameter", "n", "t.yaml", 4, "0", str(n), float(n), {"n": str(n)})
        for n in (8, 4)
    ]
    every = [CureCandidate(change, 1.0, "") for change in steps]
    trials = Scripted(lambda n, seed: n != "")
    answer = CureSearch(order, every, lambda _order: True, 2, 1, 60.0, clock=lambda: 0.0).run(
        trials
    )
    assert answer.cures()[0].candidate.change.after == "4"


def test_an_option_with_which_the_run_was_started_comes_before_the_ports_of_the_failed_node() -> (
    None
):
    analysis = analyse(read(TREE, "t.yaml"), Registry({}))
    options = (Option("mass", "auto", ""), Option("tilt", "6 deg", ""))
    knobs = Knobs(
        analysis, {"mass": "1.2 kg"}, options, "c.yaml", "options:\n  mass: auto\n  tilt: 6 deg\n"
    )
    first = candidates(knobs, RunEvidence())[0].change
    assert (first.kind, first.name, first.line, first.after) == ("option", "mass", 2, "auto")
