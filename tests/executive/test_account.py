"""The robot's own result: evidence, what is lacking, and how a world's truth contradicts it."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_runs import make

from pomona.executive import Skill
from pomona.executive.account import HELD_FRUIT, Account, AccountEntry, disagreement
from pomona.executive.language import read
from pomona.executive.registry import Registry
from pomona.executive.running.starting import RunResult


def code(account: Account, success: str = "held", in_hand: str | None = "a fruit") -> str:
    account.success = success
    doubt = account.doubt(in_hand)
    return "" if doubt is None else doubt.code


def of(*entries: AccountEntry) -> Account:
    account = Account()
    for entry in entries:
        account.add(entry)
    return account


def test_a_success_that_no_device_measured_is_unverified() -> None:
    assert code(of()) == code(of(AccountEntry("put_away", "pads"))) == "UNVERIFIED"
    assert code(of(AccountEntry("held", "pads 2.0 N"))) == ""
    assert code(of(AccountEntry("nothing_left", "picture")), "put_away") == ""
    assert code(of(AccountEntry("nothing_left", "picture")), "held") == "UNVERIFIED"
    assert code(of(), "") == "", "the tree declares no success: its end is one"


def test_a_hand_that_is_empty_at_the_end_holds_nothing() -> None:
    assert code(of(AccountEntry("held", "pads 2.0 N")), in_hand="") == "DONE_IN_PART"
    assert code(of(AccountEntry("put_away", "pads")), "put_away", in_hand="") == ""


def test_what_is_lacking_is_lacking_until_it_is_withdrawn() -> None:
    account = of(AccountEntry("put_away", "pads"), AccountEntry("fruit 2", "left at (1, 2) mm"))
    assert code(account, "put_away") == "DONE_IN_PART"
    account.add(AccountEntry("fruit 2", ""))
    assert code(account, "put_away") == ""


def test_what_a_fruit_lacked_in_the_hand_stays_once_it_is_put_away() -> None:
    account = of(AccountEntry(HELD_FRUIT, "it has turned"), AccountEntry(HELD_FRUIT, ""))
    account.add(AccountEntry("put_away", "pads"))
    assert code(account, "put_away") == "", "gripped again, and right then"
    account.add(AccountEntry(HELD_FRUIT, "it has turned"))
    account.add(AccountEntry("put_away", "pads"))
    account.add(AccountEntry(HELD_FRUIT, ""))
    account.add(AccountEntry("put_away", "pads"))
    assert code(account, "put_away") == "DONE_IN_PART"
    assert list(filter(None, account.lacking.values())) == ["it has turned"]


def test_the_largest_press_is_reported_and_one_beyond_the_limit_is_lacking() -> None:
    account = of(AccountEntry("held", "pads"), AccountEntry("the pads", "", 0.4))
    account.success = "held"
    account.add(AccountEntry("its support", "2.9 N", 0.9), "pick/Release")
    assert code(account) == ""
    assert account.report()["press"] == 0.9
    assert account.report()["pressed"] == "Release: 2.9 N"
    account.add(AccountEntry("its support", "pressed with 3.9 N", 1.33), "pick/Put into the crate")
    account.add(AccountEntry("its support", "pressed with 3.3 N", 1.11), "pick/Put into the crate")
    doubt = account.doubt("a fruit")
    assert doubt is not None
    assert doubt.message == "Put into the crate: pressed with 3.9 N"
    assert account.report()["press"] == 1.33, "the figure of the sentence"


@pytest.mark.parametrize(
    ("outcome", "account", "truth", "found"),
    [
        ("success", {"success": "held"}, {"lifted": None}, "FALSE_SUCCESS"),
        ("success", {"success": "held"}, {"lifted": True}, ""),
        ("failure", {"success": "held"}, {"lifted": True}, "FALSE_FAILURE"),
        ("failure", {"success": "held"}, {"lifted": False}, ""),
        ("partial", {"success": "put_away", "count": 2}, {"put_away": 1}, "FALSE_SUCCESS"),
        ("success", {"success": "put_away", "count": 2}, {"put_away": 3}, "FALSE_FAILURE"),
        ("success", {"success": "put_away", "count": 2}, {"put_away": 2, "bruised": 1}, "FALSE_SUCCESS"),
        ("partial", {"success": "put_away", "count": 2}, {"put_away": 2, "bruised": 1}, ""),
        ("success", {"success": ""}, {"lifted": False}, ""),
        ("success", None, {"lifted": False}, ""),
        ("success", {"success": "held"}, None, ""),
    ],
)  # fmt: skip
def test_truth_that_contradicts_the_robot_is_named(
    outcome: str, account: object, truth: object, found: str
) -> None:
    assert disagreement(outcome, account, truth).partition(":")[0] == found


class Claims(Skill):
    """Publish one entry."""

    def run(self, about: str, words: str) -> None:
        self.account(about, words)


def end_of(about: str) -> RunResult:
    text = f"pomona: 1\ntree: t\nsuccess: held\nroot: {{Claims: {{about: {about}, words: measured}}}}\n"
    runner, _cell, _events = make(text, Registry({"Claims": Claims}))
    return runner.run()


def test_the_run_ends_as_its_account_says() -> None:
    assert end_of("held").outcome == "success"
    unverified = end_of("put_away")
    assert unverified.outcome == "partial"
    assert unverified.reason is not None
    assert unverified.reason.code == "UNVERIFIED"
    assert unverified.account == {
        "success": "held", "count": 0, "evidence": "", "press": 0.0, "pressed": "",
    }  # fmt: skip


def test_a_word_that_nothing_measures_is_refused() -> None:
    (finding,) = read(
        "pomona: 1\ntree: t\nsuccess: done\nroot: {succeed: {}}\n", Path("t.yaml")
    ).findings
    assert (finding.line, finding.column) == (3, 10)
    assert "held: the hand holds" in finding.hint
