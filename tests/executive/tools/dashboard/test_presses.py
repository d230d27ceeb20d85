"""ButtonPresses arrive once, in time, or not at all; a stop reaches a run that is only being prepared."""

from __future__ import annotations

import asyncio
import json
import threading
from pathlib import Path
from typing import Any

import pytest
from fake_cell import FakeCell
from starlette.testclient import TestClient

from pomona.executive.language import build, read
from pomona.executive.registry import Registry
from pomona.executive.running.events import OperatorActed, SafeStopped
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import StartCancelledError
from pomona.executive.running.tick import EventStream
from pomona.tools.dashboard import presses
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError
from pomona.tools.dashboard.presses import (
    PATIENCE,
    SAFE_STOP_PATIENCE,
    ButtonPresses,
    TooLateError,
    now,
)
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard
from tests.executive.loops import in_loop

HOST = "127.0.0.1:8420"


class StoppedControlLock(ControlLock):
    """Counts safe stops; each waits until the test lets it go."""

    def __init__(self) -> None:
        super().__init__()
        self.stops: list[str] = []
        self.go = threading.Event()

    def safe_stop(self, who: str) -> str:
        self.stops.append(who)
        self.go.wait(120.0)
        return "safe state"


def press(**fields: Any) -> dict[str, Any]:
    return {
        "press": "p1",
        "action": "safe_stop",
        "who": "ada",
        "viewer": "v",
        "pressed": now(),
        **fields,
    }


def make_runner(cell: FakeCell, events: EventStream) -> Runner:
    document = read("pomona: 1\ntree: rest\nroot:\n  wait: 1 s\n", "tree.yaml")
    return Runner(
        lambda context, board: build(document, Registry({}), context=context, board=board), cell, events
    )  # fmt: skip


def test_a_press_that_comes_again_is_carried_out_once_and_answered_each_time() -> None:
    desk = StoppedControlLock()

    async def twice() -> list[dict[str, Any]]:
        served = ButtonPresses(desk)
        answers = asyncio.gather(served.answer(press()), served.answer(press()))
        await asyncio.sleep(0)
        desk.go.set()
        return [*await answers, await served.answer(press())]

    answers = in_loop(twice())
    assert [answer["confirmed"] for answer in answers] == ["safe state"] * 3
    assert desk.stops == ["ada"]


@pytest.mark.parametrize(
    ("action", "patience"), [("safe_stop", SAFE_STOP_PATIENCE), ("resume", PATIENCE)]
)
def test_an_old_press_is_not_carried_out(action: str, patience: float) -> None:
    desk = StoppedControlLock()
    for pressed in (now() - patience - 0.1, float("nan"), float("-inf"), -(10**400)):
        with pytest.raises(TooLateError):
            in_loop(ButtonPresses(desk).answer(press(action=action, pressed=pressed)))
    assert desk.stops == []


def test_a_stop_is_carried_out_whatever_stands_for_its_time() -> None:
    for odd in (10**400, True, "noon", None, [], now() + 60.0):
        desk = StoppedControlLock()
        desk.go.set()
        assert (
            in_loop(ButtonPresses(desk).answer(press(action="safe_stop", pressed=odd)))["confirmed"]
            == "safe state"
        )


def test_a_safe_stop_that_hangs_in_a_driver_holds_up_nothing_else() -> None:
    desk = StoppedControlLock()

    async def hang() -> str:
        served = ButtonPresses(desk)
        hanging = asyncio.ensure_future(served.answer(press()))
        await asyncio.sleep(0)
        taken = await asyncio.wait_for(served.answer(press(press="p2", action="take")), 60.0)
        desk.go.set()
        await hanging
        return str(taken["held_by"])

    assert in_loop(hang()) == "ada"


def test_old_answers_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presses, "MOST_ANSWERS", 3)
    served = ButtonPresses(ControlLock())

    async def many() -> int:
        for number in range(10):
            await served.answer(press(press=str(number), action="take"))
        return len(served._answers)

    assert in_loop(many()) == 3


def test_a_stop_while_a_run_is_prepared_keeps_it_from_beginning() -> None:
    desk, cell, events = ControlLock(), FakeCell(), EventStream()
    starting = desk.prepare("rest")
    starting.reach("reading the tree")
    assert desk.safe_stop("ada") == "the run that was being prepared does not begin"
    assert desk.start is not None
    assert desk.start["cancelled"] == "safe stop by ada"
    with pytest.raises(StartCancelledError, match="safe stop by ada"):
        starting.refuse_cancelled()
    runner = make_runner(
        cell, events
    )  # connecting could not be interrupted: the cell that it gave stops at once
    starting.attach(runner)
    assert cell.latched == "safe stop by ada"
    told: list[Any] = []
    events.subscribe(told.append)
    result = runner.run()
    assert (result.outcome, result.ticks) == ("stopped", 0)
    assert any(isinstance(event, SafeStopped) for event in told)


def test_a_stop_is_confirmed_only_when_the_cell_has_taken_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    desk, cell = ControlLock(), FakeCell()
    assert desk.safe_stop("ada") == "nothing was running"
    desk.serve(make_runner(cell, EventStream()))
    monkeypatch.setattr(cell, "safe_stop", lambda _reason: None)
    with pytest.raises(RefusedError, match="emergency stop"):
        desk.safe_stop("ada")
    monkeypatch.undo()
    assert desk.safe_stop("ada") == "safe state: safe stop by ada"


def test_the_reason_why_a_run_did_not_begin_is_shown_until_the_next_one() -> None:
    desk = ControlLock()
    desk.prepare("rest")
    desk.clear("the camera does not answer")
    assert desk.start == {"tree": "rest", "problem": "the camera does not answer"}
    desk.prepare("rest").begin()
    assert desk.start is None
    desk.clear()
    assert desk.start is None


def test_the_live_stream_answers_pings_arms_a_page_and_takes_its_presses(tmp_path: Path) -> None:
    dashboard = Dashboard(Access("127.0.0.1", 8420), tmp_path)
    client = TestClient(dashboard.app, base_url=f"http://{HOST}")

    def answer(socket: Any, event: str) -> Any:
        while True:
            for line in socket.receive_text().split("\n"):
                if f'"event": "{event}"' in line:
                    return json.loads(line)

    with client.websocket_connect("/live", headers={"host": HOST}) as socket:
        before = now()
        for odd in (
            "[]",
            "not JSON",
            '{"ping": {"deep": [1]}}',
            "[" * 9_000,
            '{"ping": NaN}',
            '{"token": "\\ud800"}',
        ):
            socket.send_text(odd)
        socket.send_json({"ping": 7})
        pong = answer(socket, "Pong")
        assert pong["ping"] == 7
        assert before <= pong["now"] <= now()
        socket.send_json(press())
        assert "watch but not act" in answer(socket, "Pressed")["error"]
        socket.send_json({"token": "wrong"})
        assert answer(socket, "Armed")["armed"] is False
        socket.send_json({"token": dashboard.access.token, "viewer": "v"})
        assert answer(socket, "Armed")["armed"] is True
        socket.send_json(press())
        assert answer(socket, "Pressed")["confirmed"] == "nothing was running"
        socket.send_json(press(press="p2", action="pause"))
        assert "take it first" in answer(socket, "Pressed")["error"]


def test_a_double_click_and_a_second_page_answer_one_question_once() -> None:
    """Each press names the question that was on its screen, whenever it arrives."""
    desk, cell, events = ControlLock(), FakeCell(), EventStream()
    document = read("pomona: 1\ntree: asked\nroot: {ask: Is it ripe?, repeat: 2}\n", "tree.yaml")
    runner = Runner(
        lambda context, board: build(document, Registry({}), context=context, board=board),
        cell,
        events,
        attended=True,
    )
    desk.serve(runner)
    desk.take("v", "ada")
    served, refused = ButtonPresses(desk), []

    async def send(number: int, viewer: str, name: str) -> None:
        try:
            asked = press(
                press=name, action="answer", viewer=viewer, detail="yes ← asked", number=number
            )
            await served.answer(asked)
        except RefusedError as error:
            refused.append(str(error))

    def act() -> None:
        open_ = runner.tree.questions["asked"].starts if runner.tree.questions["asked"].open else 0
        if open_ == 1:
            in_loop(send(1, "v", "first click"))
            in_loop(send(1, "v", "second click"))  # in the same tick
        elif open_ == 2:
            in_loop(send(1, "v", "third click"))  # on a slow link
            desk.take("w", "bob")
            in_loop(send(2, "v", "without control"))
            in_loop(send(True, "w", "no number"))
            in_loop(send(2, "w", "bob's"))

    check = cell.check
    cell.check = lambda: (act(), check())[1]  # type: ignore[method-assign]
    told: list[Any] = []
    events.subscribe(told.append)
    assert runner.run().outcome == "success"
    acts = [(e.action, e.who) for e in told if isinstance(e, OperatorActed) and "←" in e.detail]
    assert acts == [("answer", "ada"), ("too_late", "ada"), ("answer", "bob")]
    assert refused == [
        "asked now asks question 2; the answer names question 1",
        "bob holds control; take it first",
        "asked now asks question 2; the answer names question 0",
    ]
