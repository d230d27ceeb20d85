"""ButtonPresses of buttons: each is carried out once, in time or not at all, and answered."""

from __future__ import annotations

import asyncio
import math
import time
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import orjson

from pomona.executive.recording.plain_file import is_deep
from pomona.executive.running.requests import LATE
from pomona.tools.dashboard.control_lock import RefusedError, RunControl

SAFE_STOP_PATIENCE = 10.0
"""Time for which a page tries to deliver a safe stop [s]. A later one is refused as outdated."""

PATIENCE = LATE
"""The same for everything else."""

MOST_ANSWERS = 256
"""Answers that are kept for presses that come again."""


class TooLateError(RefusedError):
    """A press that was made too long ago."""


class ButtonPresses:
    """Requests of pages. A press arrives over the live stream, or as a request, repeatedly until it is answered: its id
    `press` makes them one. Use it in the server's loop."""

    def __init__(self, lock: RunControl) -> None:
        self._lock = lock
        self._answers: OrderedDict[str, asyncio.Future[dict[str, Any]]] = OrderedDict()
        # A driver may let a safe stop wait; neither the server nor another safe stop waits with it.
        self._stopping = ThreadPoolExecutor(4, thread_name_prefix="pomona-stop")
        self._acting = ThreadPoolExecutor(4, thread_name_prefix="pomona-act")

    async def answer(self, body: dict[str, Any]) -> dict[str, Any]:
        """Carry an action out, unless it was already.

        Returns:
            the holder of control, and the confirmation.

        Raises RefusedError: it is not carried out.
        """
        return await self.once(body, self._carry_out)

    async def once(
        self, body: dict[str, Any], carry_out: Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]
    ) -> dict[str, Any]:
        """Carry a press out in time and once: a press that comes again gets the first answer.

        Raises RefusedError: it is not carried out.
        """
        press = text(body, "press")
        if not press:
            return await carry_out(body)
        if press not in self._answers:
            self._answers[press] = asyncio.ensure_future(carry_out(body))
            while len(self._answers) > MOST_ANSWERS:
                self._answers.popitem(last=False)
        return await asyncio.shield(self._answers[press])

    async def _carry_out(self, body: dict[str, Any]) -> dict[str, Any]:
        action = text(body, "action")
        viewer = text(body, "viewer")
        who = text(body, "who")[:60] or "operator"
        confirmed = ""
        refuse_late(body, SAFE_STOP_PATIENCE if action == "safe_stop" else PATIENCE)
        loop = asyncio.get_running_loop()
        if action == "safe_stop":
            confirmed = await loop.run_in_executor(self._stopping, self._lock.safe_stop, who)
        else:
            name, *arguments = {
                "take": ("take", viewer, who),
                "release": ("release", viewer),
                "acknowledge": ("acknowledge", viewer),
            }.get(action, ("act", viewer, action, text(body, "detail"), number_of(body)))
            await loop.run_in_executor(self._acting, self._lock.call, name, *arguments)
        held = self._lock.standing.holder
        yours = bool(viewer) and held.viewer == viewer
        return {"held_by": held.who, "grant": held.grant, "yours": yours, "confirmed": confirmed}


def now() -> float:
    """Return the server's clock [s], to which the timestamps of presses refer."""
    return time.monotonic()


def refuse_late(body: dict[str, Any], patience: float = PATIENCE) -> None:
    """Refuse a press that comes more than `patience` after it was made [s]. Raises TooLateError: it is too late."""
    pressed = body.get("pressed")
    if not isinstance(pressed, (int, float)) or isinstance(pressed, bool):
        return
    try:
        ago = now() - pressed
    except OverflowError:  # an integer that is no time at all
        ago = math.inf if pressed < 0 else -math.inf
    if not ago <= patience:
        raise TooLateError(f"the press is {ago:.3g} s old, too old to be executed")


def text(body: dict[str, Any], key: str) -> str:
    """Return a text of a message; empty when there is none, or something else stands there."""
    value = body.get(key, "")
    return value if isinstance(value, str) else ""


def number_of(body: dict[str, Any]) -> int:
    """Return the number of the question or pause that a message names; 0, which none has, when it names none."""
    value = body.get("number", 0)
    return value if isinstance(value, int) and not isinstance(value, bool) else 0


def object_of(said: str | bytes) -> dict[str, Any]:
    """A message as an object; empty for anything that is no JSON object, also for NaN, half characters and depth."""
    coded = said.encode(errors="replace") if isinstance(said, str) else said
    try:
        content = {} if is_deep(coded) else orjson.loads(coded)
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
