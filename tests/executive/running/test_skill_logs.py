"""Lines that skills log: with their node, in the run's events, never more than a record bears."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_runs import make
from recorded_events import started

from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.well_known import well_known
from pomona.executive.registry import Registry
from pomona.executive.running.events import Event, Logged, RunEnded, SafeStopped
from pomona.executive.running.traces import MOST_LOGGED, SkillLogs
from pomona.executive.skill import POLLED, Interrupted, Skill, Work
from pomona.executive.values.processes import within
from pomona.tools.dashboard.explain import MOST_LINES, explain
from pomona.tools.library.difference import first_difference

log = logging.getLogger("somebody.elses.package")


class Chatter(Skill):
    """Log two lines."""

    def run(self) -> Work[None]:
        log.debug("nothing for a record")
        log.info("the scale reads %.1f g", 151.5)
        yield None
        self.logger.warning("the scale drifts")


class Floods(Skill):
    """Log in a loop."""

    def run(self) -> Work[None]:
        for number in range(100):
            log.info("line %d", number)
        yield None


class ComputesAloud(Skill):
    """Log in a thread that computes."""

    def run(self) -> Work[None]:
        yield from self.compute(log.warning, "from a thread")


class LeavesAloud(Skill):
    """Log while it is interrupted."""

    def run(self) -> Work[None]:
        try:
            while True:
                yield None
        except Interrupted:
            log.info("put it down")
            raise


class Stumbles(Skill):
    """Log an exception, then raise one."""

    def run(self) -> Work[None]:
        try:
            raise ValueError("out of range")
        except ValueError:
            log.exception("the scale")
        yield None
        log.error("last words")
        raise ZeroDivisionError


REGISTRY = Registry(
    {skill.__name__: skill for skill in (Chatter, Floods, ComputesAloud, LeavesAloud, Stumbles)}
)


def run(text: str) -> list[Event]:
    runner, _, events = make(f"pomona: 1\ntree: t\n{text}\n", REGISTRY)
    runner.run()
    return events


def lines(events: list[Event]) -> list[tuple[str, str, str]]:
    return [(event.node, event.level, event.text) for event in events if isinstance(event, Logged)]


@pytest.fixture(autouse=True)
def _unchanged_logging() -> Iterator[None]:
    root = logging.getLogger()
    before = root.level, list(root.handlers)
    yield
    assert (root.level, root.handlers) == before


def test_a_line_is_recorded_with_its_node_and_level_and_with_the_time_of_its_tick() -> None:
    events = run("root: {sequence: [{wait: 1 s}, {Chatter: {}}]}")
    assert lines(events) == [
        ("t/Chatter", "INFO", "the scale reads 151.5 g"),
        ("t/Chatter", "WARNING", "the scale drifts"),
    ]
    first = next(event for event in events if isinstance(event, Logged))
    assert first.t == pytest.approx(1.0, abs=0.05)


def test_explain_and_the_log_of_a_record_repeat_it() -> None:
    events = run("root: {sequence: [{Chatter: {}}, {Floods: {}}]}")
    about = {"path": "t/Chatter", "parent": "t", "name": "Chatter"}
    told = "\n".join(explain([started(nodes=(about,)), *events]))
    assert f"Of {MOST_LOGGED + 3} logged lines the last {MOST_LINES} are listed." in told
    assert "Floods logged INFO: line 3." in told
    said = [
        message for event in events for topic, _, message in well_known(event, 0) if topic == "/log"
    ]
    first = next(message for message in said if message["name"] == "t/Chatter")
    assert (first["level"], first["message"]) == (2, "the scale reads 151.5 g")


def test_repeated_runs_may_differ_in_the_text_of_a_line_alone(tmp_path: Path) -> None:
    for name, node, text in (
        ("a", "t", "took 1.2 s"),
        ("b", "t", "took 1.3 s"),
        ("c", "u", "took 1.2 s"),
    ):
        (tmp_path / name).mkdir()
        recorder = Recorder(tmp_path / name)
        recorder.on_event(Logged(0.1, 5, node, "INFO", text))
        recorder.close()
    assert first_difference(tmp_path / "a", tmp_path / "b") == (1, None)
    assert first_difference(tmp_path / "a", tmp_path / "c")[1] is not None


def test_a_flood_of_lines_is_counted_and_not_recorded() -> None:
    found = lines(run("root: {sequence: [{Floods: {}}, {Chatter: {}}]}"))
    of_flood = [text for node, _, text in found if "Floods" in node]
    assert of_flood == [
        *(f"line {n}" for n in range(MOST_LOGGED)),
        f"{100 - MOST_LOGGED} more lines were left out",
    ]
    assert len([node for node, _, _ in found if "Chatter" in node]) == 2


def test_a_thread_that_computes_for_a_skill_logs_for_it() -> None:
    assert lines(run("root: {ComputesAloud: {}}")) == [("t", "WARNING", "from a thread")]


def test_an_interrupted_skill_logs_until_it_has_halted() -> None:
    found = lines(run("root: {LeavesAloud: {}, timeout: 1 s}"))
    assert found == [("t", "INFO", "put it down")]


def test_lines_outside_of_skills_are_not_recorded() -> None:
    def chatter() -> None:
        while not done.wait(0.0):
            log.warning("from elsewhere")

    done = threading.Event()
    other = threading.Thread(target=chatter)
    other.start()
    try:
        assert len(lines(run("root: {Chatter: {}}"))) == 2
    finally:
        done.set()
        other.join()


def test_a_line_that_cannot_be_shown_is_named() -> None:
    logs = SkillLogs()
    polled = POLLED.set("t/Weigh")
    logs.handle(logging.LogRecord("scale", logging.INFO, "", 1, "%d apples", ("many",), None))
    POLLED.reset(polled)
    (line,) = logs.take(0.5, 25)
    assert (line.t, line.tick, line.node) == (0.5, 25, "t/Weigh")
    assert line.text.startswith("'%d apples' cannot be shown: ")


def test_a_thread_that_hangs_in_the_handler_holds_up_no_other() -> None:
    logs, hangs, done = SkillLogs(), threading.Event(), threading.Event()

    def hang() -> None:
        logs.acquire()
        hangs.set()
        done.wait(60.0)

    hanging = threading.Thread(target=hang)
    hanging.start()
    try:
        assert hangs.wait(10.0)
        within(
            10.0,
            lambda: logs.handle(logging.LogRecord("scale", logging.INFO, "", 1, "150 g", (), None)),
        )
    finally:
        done.set()
        hanging.join()


def test_last_words_of_a_skill_that_breaks_are_recorded_after_the_safe_stop() -> None:
    events = run("root: {Stumbles: {}}")
    assert [text for _, _, text in lines(events)] == ["the scale: out of range", "last words"]
    ended = events[-1]
    assert isinstance(ended, RunEnded)
    assert ended.outcome == "error"
    stop = next(number for number, event in enumerate(events) if isinstance(event, SafeStopped))
    assert [event.text for event in events[stop:] if isinstance(event, Logged)] == ["last words"]
