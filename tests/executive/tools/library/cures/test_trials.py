"""Repetitions in processes of their own, and `pomona why` as a person uses it on the simulated cell."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pomona.executive.cli import main
from pomona.executive.execute import RunOrder
from pomona.tools.library.cures.trials import Trial, TrialPool, run_trial

TREE = "pomona: 1\ntree: t\nroot: {wait: 1 s}\n"


def die(_order: RunOrder) -> Trial:
    os._exit(9)


def hang(_order: RunOrder) -> Trial:
    time.sleep(600.0)
    return Trial("success")


def ends(work: Callable[[RunOrder], Trial], limit: float = 120.0) -> list[Trial]:
    order = RunOrder(Path("t.yaml"), Path("none.yaml"), dry=True, texts={"t.yaml": TREE})
    with contextlib.closing(TrialPool(1, work)) as pool:
        pool.start("key", order, limit)
        assert not pool.free
        return [trial for _, trial in pool.ended()]


@pytest.mark.slow
def test_a_run_is_repeated_in_another_process() -> None:
    (trial,) = ends(run_trial)
    assert trial.succeeded
    assert trial.time == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_a_process_that_dies_or_hangs_ends_its_repetition_alone() -> None:
    assert [(trial.outcome, trial.code) for trial in ends(die)] == [("lost", "WORKER_DIED")]
    assert [(trial.outcome, trial.code) for trial in ends(hang, limit=0.01)] == [
        ("lost", "OVER_BUDGET")
    ]


@pytest.mark.slow
def test_a_repetition_that_is_given_up_is_no_result_of_the_next_search() -> None:
    order = RunOrder(Path("t.yaml"), Path("none.yaml"), dry=True, texts={"t.yaml": TREE})
    with contextlib.closing(TrialPool(1, hang)) as pool:
        pool.start("first search", order, 0.01)
        pool.give_up()
        assert pool.free
        assert list(pool.ended()) == []


def test_a_run_that_cannot_start_is_unusable_and_nothing_else_ends() -> None:
    order = RunOrder(Path("t.yaml"), Path("none.yaml"), dry=True, texts={"t.yaml": "pomona: 1\n"})
    assert run_trial(order).outcome == "unusable"


@pytest.mark.long
def test_a_pick_with_the_wrong_fruit_is_cured_on_the_simulated_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = ("kind=lemon", "distractors=0", "looks=1")
    assert (
        main(
            [
                "run",
                "pick_apple",
                "--quiet",
                *(word for text in settings for word in ("--set", text)),
            ]
        )
        == 1
    )
    capsys.readouterr()
    assert main(["why", "last", "--budget", "10 min", "--seeds", "1", "--jobs", "2", "--json"]) == 0
    (cure,) = json.loads(capsys.readouterr().out.splitlines()[-1])["cures"]
    assert (cure["name"], cure["before"], cure["after"]) == ("kind", "lemon", "apple")
    assert cure["successes"] == 2
