"""A running run on ROS 2: topics of its events, services that act, an action that runs a tree.

A caller needs the token of this start and, except for a safe stop, control, which one operator has at a time. At
another address than the local one the bridge accepts no commands.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.recording.folder import EVENTS
from pomona.executive.recording.schemas import Schema
from pomona.executive.views import ImageView
from pomona.tools.ros2.peer import Reply, Ros2Peer
from pomona.tools.ros2.to_ros2 import (
    RosMessage,
    ToRos2,
    colour_message,
    depth_message,
    diagnostics,
    time_of,
)
from pomona.tools.ros2.types import coder

ACT = "pomona_msgs/srv/Act"
RUN_TREE = "pomona_msgs/action/RunTree"
ACTIONS = (
    "take",
    "release",
    "pause",
    "resume",
    "step",
    "stop",
    "speed",
    "safe_stop",
    "acknowledge",
)
# action_msgs/GoalStatus
EXECUTING = 2
SUCCEEDED = 4
CANCELED = 5
ABORTED = 6
MOST_NAME = 60  # letters of an operator's name, as for the page
Starts = Callable[
    [dict[str, Any]], str
]  # begins the run that a form describes, as the dashboard's page fills it in


class RequestRefused(PomonaError):
    """A request of a node that is not carried out, and why."""


class OperatorControl(Protocol):
    """The operator's control of a run, as the page has it."""

    @property
    def start(self) -> dict[str, Any] | None:
        """The run in preparation, or the reason why the last one did not begin."""

    def take(self, viewer: str, who: str) -> None:
        """Take control."""

    def release(self, viewer: str) -> None:
        """Give control back."""

    def acknowledge(self, viewer: str) -> None:
        """Release the latch of the safe state."""

    def act(self, viewer: str, action: str, detail: str = "", number: int = 0) -> None:
        """Pass an action to the run."""

    def safe_stop(self, who: str) -> str:
        """Stop now; return the confirmation."""

    def cancel_start(self, viewer: str) -> bool:
        """Let the run that is being prepared not begin; False when none is."""


@dataclass(slots=True)
class _Goal:
    uuid: bytes
    viewer: str
    accepted: int
    status: int = EXECUTING
    began: bool = False
    canceled: bool = False
    result: dict[str, Any] = field(default_factory=dict)
    # requests for a goal's result that are kept; of more, the oldest get none
    waiting: deque[Reply] = field(default_factory=lambda: deque(maxlen=64))


class Ros2Bridge:
    """A sink of `Live` that also takes requests."""

    def __init__(
        self,
        peer: Ros2Peer,
        control: OperatorControl | None,
        acts_with: Callable[[str], bool],
        start: Starts | None = None,
    ) -> None:
        """
        Args:
            peer: the node of this process.
            control: acts on the run, for one operator at a time; None: nothing is served.
            acts_with: returns True if a token may act.
            start: begins runs, where that can be done.
        """
        self._peer = peer
        self._start = start
        self._acts_with = acts_with if peer.local else lambda _token: False
        self._run = ToRos2()
        self._links: dict[str, str] = {}
        self._said = 0.0
        self._goal: _Goal | None = None
        self._lock = threading.Lock()
        if control is None:
            return
        self._control = control
        for action in ACTIONS:
            peer.serve(f"/pomona/{action}", ACT, partial(self._answer, action))
        if start is not None:
            name = "/pomona/run_tree/_action"
            peer.serve(f"{name}/send_goal", f"{RUN_TREE}_SendGoal", self._send_goal)
            peer.serve(f"{name}/get_result", f"{RUN_TREE}_GetResult", self._get_result)
            peer.serve(f"{name}/cancel_goal", "action_msgs/srv/CancelGoal", self._cancel_goal)

    # ------------------------------------------------------------------------------------ what happens

    def send(self, topic: str, schema: Schema, content: Mapping[str, Any], stamp: int) -> None:
        for message in self._run.messages(topic, content, stamp):
            self._publish(message)
        if topic == EVENTS:
            if content["event"] == "LinkChanged":
                self._links[content["device"]] = content["state"]
            self._follow_goal(content, stamp)

    def show(self, topic: str, view: ImageView, stamp: int) -> None:
        if view.image is not None:
            self._publish(RosMessage(*colour_message(topic, f"camera/{topic}", view.image, stamp)))
        if view.depth is not None:
            metres = np.where(np.isfinite(view.depth), view.depth, np.float32(0.0)).astype(
                np.float32
            )
            self._publish(RosMessage(*depth_message(topic, f"camera/{topic}", metres, stamp)))

    def rest(self) -> None:
        if (
            self._links and time.monotonic() - self._said > 1.0
        ):  # period of the diagnostics, for late subscribers [s]
            self._said = time.monotonic()
            self._publish(diagnostics(time.time_ns(), self._links))
        if self._goal is None:
            return
        with self._lock:  # a goal that is being taken has not cleared the last one's problem yet
            goal = self._goal
            start = self._control.start
        if goal.status == EXECUTING and start is not None and "problem" in start:
            self._end_goal(
                goal,
                {"outcome": "stopped" if goal.canceled else "error", "reason": start["problem"]},
            )

    def close(self) -> None:
        self._peer.close()

    def _publish(self, message: RosMessage) -> None:
        self._peer.publish(
            message.topic, message.type, coder(message.type).coded(message.fields), message.stamp
        )

    # --------------------------------------------------------------------------------------- services

    def _answer(self, action: str, asked: Any, reply: Reply) -> None:
        reply(self._act(action, asked))

    def _act(self, action: str, asked: Any) -> dict[str, Any]:
        try:
            viewer, who = self._admitted(asked)
            return {
                "success": True,
                "message": self._do(action, viewer, who, str(asked.detail)) or "done",
            }
        except PomonaError as error:
            return {"success": False, "message": str(error)}

    def _do(self, action: str, viewer: str, who: str, detail: str) -> str:
        if action == "take":
            self._control.take(viewer, who)
        elif action == "release":
            self._control.release(viewer)
        elif action == "safe_stop":
            return self._control.safe_stop(who)
        elif action == "acknowledge":
            self._control.acknowledge(viewer)
        elif action in ("resume", "step"):
            self._control.act(viewer, action, number=_number(detail))
        else:
            self._control.act(viewer, action, detail)
        return ""

    def _admitted(self, asked: Any) -> tuple[str, str]:
        """Return the viewer's id and the operator's name.

        Raises RequestRefused: the token is wrong, or the operator's name is missing.
        """
        if not self._acts_with(asked.token):
            raise RequestRefused(
                "actions need the token that Pomona printed on this machine at the start"
            )
        who = "".join(
            letter for letter in asked.who[: 2 * MOST_NAME] if letter.isprintable()
        ).strip()[:MOST_NAME]
        if not who:
            raise RequestRefused("the operator's name is missing")
        return f"ros2:{who}", who

    # ----------------------------------------------------------------------------------------- action

    def _send_goal(self, asked: Any, reply: Reply) -> None:
        now = time.time_ns()
        try:
            viewer, who = self._admitted(asked.goal)
            self._begin_goal(
                _Goal(bytes(asked.goal_id.uuid), viewer, now), _form(asked.goal, viewer, who)
            )
            self._control.take(viewer, who)
            accepted = True
        except (PomonaError, OSError, ValueError) as error:
            self._say(f"a goal was refused: {error}", now)
            accepted = False
        reply({"accepted": accepted, "stamp": time_of(now)})
        if accepted:
            self._say_status(now)

    def _begin_goal(self, goal: _Goal, form: dict[str, Any]) -> None:
        """Begin its run. It is the goal before that: a run may be over before this returns.

        Raises:
            RequestRefused: a run is going on, or the launcher refuses the start.
            UsageError: the tree or cell cannot be used.
        """
        assert self._start is not None
        with self._lock:
            before = self._goal
            if before is not None and before.status == EXECUTING:
                raise RequestRefused("a run is going on")
            self._goal = goal
            try:
                self._start(form)
            except BaseException:
                self._goal = before
                raise

    def _get_result(self, asked: Any, reply: Reply) -> None:
        with self._lock:
            goal = self._goal
            if goal is not None and goal.uuid == bytes(asked.goal_id.uuid):
                if goal.status == EXECUTING:
                    goal.waiting.append(reply)
                else:
                    reply({"status": goal.status, "result": goal.result})
                return
        reply({"status": 0, "result": {}})  # unknown

    def _cancel_goal(self, asked: Any, reply: Reply) -> None:
        goal = self._goal
        wanted = bytes(asked.goal_info.goal_id.uuid)
        if goal is None or wanted not in (goal.uuid, bytes(16)):
            reply({"return_code": 2})
            return
        if goal.status != EXECUTING:
            reply({"return_code": 3})
            return
        # first: the run may end before this goes on
        before = goal.canceled
        goal.canceled = True
        try:
            if not self._control.cancel_start(goal.viewer):
                self._control.act(goal.viewer, "stop")
        except PomonaError as error:
            goal.canceled = before
            self._say(f"a goal was not cancelled: {error}", time.time_ns())
            reply({"return_code": 1})
            return
        reply({"return_code": 0, "goals_canceling": [self._info(goal)]})

    def _follow_goal(self, event: Mapping[str, Any], stamp: int) -> None:
        goal = self._goal
        if goal is None or goal.status != EXECUTING:
            return
        goal.began = goal.began or event["event"] == "RunStarted"
        if not goal.began:
            return  # the run before has its last words
        if event["event"] == "NodeChanged":
            feedback = {
                "node": event["path"],
                "status": event["status"],
                "feedback": event["feedback"],
                "t": event["t"],
                "tick": event["tick"],
            }
            fields = {"goal_id": {"uuid": goal.uuid}, "feedback": feedback}
            self._publish(
                RosMessage(
                    "/pomona/run_tree/_action/feedback",
                    f"{RUN_TREE}_FeedbackMessage",
                    stamp,
                    fields,
                )
            )
        elif event["event"] == "RunEnded":
            reason = event["reason"] or {"code": "", "message": ""}
            result = {
                "outcome": event["outcome"],
                "code": reason["code"],
                "reason": reason["message"],
                "time": event["time"],
            }
            self._end_goal(goal, result)

    def _end_goal(self, goal: _Goal, result: dict[str, Any]) -> None:
        succeeded = result["outcome"] == "success"
        status = SUCCEEDED if succeeded else CANCELED if goal.canceled else ABORTED
        with self._lock:
            goal.status = status
            goal.result = result
        self._say_status(time.time_ns())
        while goal.waiting:
            goal.waiting.popleft()({"status": status, "result": result})

    def _say_status(self, now: int) -> None:
        if self._goal is not None:
            told = {
                "status_list": [{"goal_info": self._info(self._goal), "status": self._goal.status}]
            }
            self._publish(
                RosMessage(
                    "/pomona/run_tree/_action/status", "action_msgs/msg/GoalStatusArray", now, told
                )
            )

    def _info(self, goal: _Goal) -> dict[str, Any]:
        return {"goal_id": {"uuid": goal.uuid}, "stamp": time_of(goal.accepted)}

    def _say(self, text: str, now: int) -> None:
        fields = {"stamp": time_of(now), "level": 30, "name": "pomona.ros2", "msg": text}
        self._publish(RosMessage("/rosout", "rcl_interfaces/msg/Log", now, fields))


def _number(detail: str) -> int:
    """Return the number of a pause; 0, which none has, when it is none."""
    return int(detail) if len(detail) < 10 and detail.isdecimal() else 0


def _form(asked: Any, viewer: str, who: str) -> dict[str, Any]:
    """Return the start form's values. Raises UsageError: names and values do not belong together."""
    if len(asked.names) != len(asked.values):
        raise UsageError(
            f"each name needs its value: there are {len(asked.names)} names and {len(asked.values)} values"
        )
    if len(set(asked.names)) < len(asked.names):
        raise UsageError(f"a name comes twice: {', '.join(asked.names)}")
    settings = dict(zip(asked.names, asked.values, strict=True))
    form = {
        "viewer": viewer,
        "who": who,
        "tree": asked.tree,
        "seed": int(asked.seed),
        "settings": settings,
    }
    return {**form, "cell": asked.cell} if asked.cell else form
