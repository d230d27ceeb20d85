"""A paused run takes over a changed tree file where that is safe; otherwise the reason is given and nothing changes."""

from __future__ import annotations

import difflib

import pytest
from fake_runs import Turn, make

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.language.changes import InputChange, ReloadRefusedError, taken_over
from pomona.executive.registry import Registry
from pomona.executive.running.events import NodeChanged, OperatorActed
from pomona.executive.running.requests import AnswerRefusedError
from pomona.executive.running.starting import RunState
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError

TEXT = """
pomona: 1
tree: turn
parameters:
  tries: {type: int, default: 2}
  long: {type: time, default: 1 s}
root:
  sequence:
    - Turn: {duration: 100 ms}
      name: First
    - Turn: {duration: 100 ms}
      name: Second
      retry: "{tries}"
    - part: {}
subtrees:
  part:
    root:
      Turn: {duration: 100 ms, turned: "{a}"}
      name: Third
"""
SKILLS = Registry({"Turn": Turn})


class Reloaded:
    """A run that is paused in its third tick and reloads a text when it is at rest."""

    def __init__(self, text: str, pause_at: int = 3) -> None:
        self.refused: PomonaError | None = None
        self.asked = False
        script = dict.fromkeys(range(1, 400), self.look)
        script[pause_at] = lambda runner, _cell: runner.pause("ada")
        self.runner, _, self.events = make(TEXT, SKILLS, script, reread=lambda: text)
        self.outcome = self.runner.run().outcome

    def look(self, runner, _cell):
        if runner.state is not RunState.PAUSED:
            return
        if not self.asked:
            self.asked = True
            try:
                runner.reload(runner.pause_number, "ada")
            except PomonaError as error:
                self.refused = error
        else:
            runner.resume(runner.pause_number, "ada")

    def ticks(self, path):
        changes = [event.tick for event in self.events if isinstance(event, NodeChanged) and event.path == path]
        return changes[-1] - changes[0]

    @property
    def acts(self):
        acts = [event for event in self.events if isinstance(event, OperatorActed)]
        return [(act.who, act.action, act.detail) for act in acts if act.action in ("reload", "change")]


def changed(old, new):
    assert TEXT.count(old) == 1
    return TEXT.replace(old, new)


SECOND = "    - Turn: {duration: 100 ms}\n      name: Second"
SLOWER = changed(SECOND, SECOND.replace("100 ms", "400 ms"))


def test_a_skill_to_come_gets_the_value_of_the_changed_file():
    run = Reloaded(SLOWER)
    assert run.refused is None
    assert run.outcome == "success"
    assert run.ticks("turn/First") < 10
    assert run.ticks("turn/Second") >= 20  # 400 ms in ticks of 20 ms
    assert run.runner.tree.document.text == SLOWER


def test_the_difference_is_recorded_and_then_each_change():
    diff = "\n".join(difflib.unified_diff(
        TEXT.splitlines(), SLOWER.splitlines(), "tree.yaml", "tree.yaml", n=0, lineterm=""
    ))  # fmt: skip
    assert Reloaded(SLOWER).acts == [("ada", "reload", diff), ("ada", "change", "duration = 400 ms ← turn/Second")]


def test_the_skill_that_runs_goes_on_in_place():
    run = Reloaded(SLOWER)
    first = [event for event in run.events if isinstance(event, NodeChanged) and event.path == "turn/First"]
    assert [(event.status, event.starts) for event in first if event.status != "INVALID"] == [
        ("RUNNING", 1),
        ("SUCCESS", 1),
    ]


def test_an_input_inside_a_subtree_is_taken_over():
    text = changed("{duration: 100 ms, turned", "{duration: 300 ms, turned")
    run = Reloaded(text)
    assert [act[2] for act in run.acts][1:] == ["duration = 300 ms ← turn/part/Third"]
    assert run.ticks("turn/part/Third") >= 15


def test_comments_and_layout_are_taken_over_without_a_change_of_any_node():
    run = Reloaded("# slower soon\n" + changed('      retry: "{tries}"', '      retry:   "{tries}"   # twice'))
    assert run.refused is None
    assert [act[1] for act in run.acts] == ["reload"]


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (
            "    - Turn: {duration: 100 ms}\n      name: First",
            "    - Turn: {duration: 300 ms}\n      name: First",
            "tree.yaml:9: duration of First has changed, but this node has started in the present pass",
        ),
        ("    - part: {}", "    - part: {}\n    - wait: 1 s", "tree.yaml:9:5: 4 items instead of 3"),
        ("    - part: {}\n", "", "tree.yaml:9:5: 2 items instead of 3"),
        ("name: Second", "name: Other", "tree.yaml:12:13: 'Other' instead of 'Second'"),
        ('retry: "{tries}"', "retry: 5", "'5' instead of '{tries}'"),
        ('      retry: "{tries}"\n', "", "'retry' is gone"),
        ("      name: Third", "      name: Third\n      timeout: 5 s", "'timeout' is new"),
        ("default: 2", "default: 3", "'3' instead of '2'"),
        ('"{a}"', '"{b}"', "tree.yaml:18: turned of Third has changed, but a wire is taken over by a new run only"),
        (SECOND, SECOND.replace("100 ms", '"{long}"'), "tree.yaml:11: duration of Second has changed, but a wire"),
    ],
)  # fmt: skip
def test_another_change_is_refused_with_its_place_and_nothing_changes(old, new, why):
    run = Reloaded(changed(old, new))
    assert isinstance(run.refused, PomonaError)
    assert why in str(run.refused)
    assert run.acts == []
    assert run.outcome == "success"
    assert run.runner.tree.document.text == TEXT


def test_one_change_that_is_refused_refuses_all():
    text = SLOWER.replace("default: 2", "default: 3")
    run = Reloaded(text)
    assert isinstance(run.refused, ReloadRefusedError)
    assert run.acts == []
    assert run.ticks("turn/Second") < 10


@pytest.mark.parametrize(("written", "why"), [("3 kg", "error"), ("[", "error"), ("400 ms, speed: 2", "speed")])
def test_a_file_with_errors_is_refused(written, why):
    run = Reloaded(SLOWER.replace("400 ms", written))
    assert isinstance(run.refused, UsageError)
    assert why in str(run.refused)
    assert run.acts == []


def test_a_file_without_a_change_is_refused():
    assert str(Reloaded(TEXT).refused) == "the tree file has not changed"


def test_a_run_reloads_only_in_its_pause_and_at_rest():
    refused = []

    def refuse(runner):
        with pytest.raises(AnswerRefusedError) as error:
            runner.reload(1)
        refused.append(str(error.value))

    def pause(runner, _cell):
        refuse(runner)
        runner.pause()

    def moving(runner, _cell):
        if runner.state is RunState.PAUSING:
            refuse(runner)

    script = {3: pause, 4: moving}
    runner, *_ = make(TEXT, SKILLS, script, go_on=True, reread=lambda: SLOWER)
    assert runner.run().outcome == "success"
    assert refused == ["the run is not paused", "the run still comes to rest"]


def test_a_request_that_the_pause_has_outlived_is_recorded_as_too_late():
    def act(runner, _cell):
        if runner.state is RunState.PAUSED:
            runner.resume(runner.pause_number)
            runner.reload(runner.pause_number, "ada")

    script = dict.fromkeys(range(4, 400), act)
    script[3] = lambda runner, _cell: runner.pause()
    runner, _, events = make(TEXT, SKILLS, script, reread=lambda: SLOWER)
    assert runner.run().outcome == "success"
    late = [event.detail for event in events if isinstance(event, OperatorActed) and event.action == "too_late"]
    assert len(late) == 1
    assert late[0].startswith("reload ---")
    assert late[0].endswith("pause already over")
    assert not any(isinstance(event, OperatorActed) and event.action in ("reload", "change") for event in events)


def test_a_run_without_a_file_refuses():
    refused = []

    def act(runner, _cell):
        if runner.state is RunState.PAUSED:
            with pytest.raises(ReloadRefusedError, match="no tree file") as error:
                runner.reload(runner.pause_number)
            refused.append(error)
            runner.resume(runner.pause_number)

    script = dict.fromkeys(range(4, 400), act)
    script[3] = lambda runner, _cell: runner.pause()
    runner, *_ = make(TEXT, SKILLS, script)
    runner.run()
    assert len(refused) == 1


def test_a_second_reload_compares_with_the_first():
    texts = iter((SLOWER, TEXT))
    current = [""]

    def act(runner, _cell):
        if runner.state is not RunState.PAUSED:
            return
        current[0] = next(texts, "")
        if current[0]:
            runner.reload(runner.pause_number, "ada")
        else:
            runner.resume(runner.pause_number)

    script = dict.fromkeys(range(4, 400), act)
    script[3] = lambda runner, _cell: runner.pause()
    runner, _, events = make(TEXT, SKILLS, script, reread=lambda: current[0])
    assert runner.run().outcome == "success"
    details = [e.detail for e in events if isinstance(e, OperatorActed) and e.action == "change"]
    assert details == ["duration = 400 ms ← turn/Second", "duration = 100 ms ← turn/Second"]


def test_on_the_page_the_operator_in_control_reloads():
    lock, refused = ControlLock(), []

    def act(runner, _cell):
        if runner.state is not RunState.PAUSED:
            return
        lock.serve(runner)
        lock.take("page 1", "Ada")
        for number in (runner.pause_number, 7):
            try:
                lock.act("page 1", "reload", "", number)
            except RefusedError as error:
                refused.append(str(error))
        runner.resume(runner.pause_number)

    script = dict.fromkeys(range(4, 400), act)
    script[3] = lambda runner, _cell: runner.pause()
    runner, _, events = make(TEXT, SKILLS, script, reread=lambda: SLOWER)
    assert runner.run().outcome == "success"
    assert refused == ["the run is in pause 1; the request names pause 7"]
    assert any(isinstance(e, OperatorActed) and (e.who, e.action) == ("Ada", "reload") for e in events)


def test_an_input_that_was_left_out_is_taken_over_and_one_that_is_gone_is_not():
    less = changed(SECOND, SECOND.replace("{duration: 100 ms}", "{}"))
    assert "'duration' is gone" in str(Reloaded(less).refused)
    runner, *_ = make(less, SKILLS)
    fresh, *_ = make(TEXT, SKILLS)
    assert taken_over(runner.tree, fresh.tree) == (InputChange("turn/Second", "duration", "100 ms"),)
