"""A paused run takes over a changed tree file where that is safe; otherwise the reason is given and nothing changes."""

from __future__ import annotations

import difflib
import itertools

import pytest
from fake_runs import Turn, make

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.language.changes import ReloadRefusedError
from pomona.executive.registry import Registry
from pomona.executive.running.events import NodeChanged, OperatorActed, TreeChanged
from pomona.executive.running.requests import AnswerRefusedError
from pomona.executive.running.starting import RunState
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError
from pomona.tools.dashboard.takeover import FileTakeover

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

    def __init__(
        self,
        text: str,
        pause_at: int = 3,
        *,
        before: str = TEXT,
        held: str = "",
        skills: Registry = SKILLS,
    ) -> None:
        self.refused: PomonaError | None = None
        self.asked = False
        script = dict.fromkeys(range(1, 400), self.look)
        script[pause_at] = lambda runner, _cell: (
            runner.break_at(held) if held else runner.pause("ada")
        )
        self.runner, _, self.events = make(
            before, skills, script, reread=lambda: text, takeover=FileTakeover
        )
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
        changes = [
            event.tick
            for event in self.events
            if isinstance(event, NodeChanged) and event.path == path
        ]
        return changes[-1] - changes[0]

    def starts(self, path):
        return max(
            event.starts
            for event in self.events
            if isinstance(event, NodeChanged) and event.path == path
        )

    @property
    def acts(self):
        acts = [event for event in self.events if isinstance(event, OperatorActed)]
        return [
            (act.who, act.action, act.detail) for act in acts if act.action in ("reload", "change")
        ]

    @property
    def ran(self):
        """Skills in the order of their ends, and how each ended."""
        leaves = [
            e
            for e in self.events
            if isinstance(e, NodeChanged) and e.status in ("SUCCESS", "FAILURE")
        ]
        skills = {skill.path for skill in self.runner.tree.skills}
        return [event.path.rpartition("/")[2] for event in leaves if event.path in skills]


def changed(old, new):
    assert TEXT.count(old) == 1
    return TEXT.replace(old, new)


SECOND = "    - Turn: {duration: 100 ms}\n      name: Second"
RETRIED = SECOND + '\n      retry: "{tries}"'
SLOWER = changed(SECOND, SECOND.replace("100 ms", "400 ms"))


def test_a_skill_to_come_gets_the_value_of_the_changed_file():
    run = Reloaded(SLOWER)
    assert run.refused is None
    assert run.outcome == "success"
    assert run.ticks("turn/First") < 10
    assert run.ticks("turn/Second") >= 20  # 400 ms in ticks of 20 ms
    assert run.runner.tree.document.text == SLOWER


def test_the_difference_and_the_nodes_of_the_changed_tree_are_recorded():
    diff = "\n".join(difflib.unified_diff(
        TEXT.splitlines(), SLOWER.splitlines(), "tree.yaml", "tree.yaml", n=0, lineterm=""
    ))  # fmt: skip
    run = Reloaded(SLOWER)
    assert run.acts == [("ada", "reload", diff)]
    (changed_tree,) = [event for event in run.events if isinstance(event, TreeChanged)]
    assert changed_tree.difference == diff
    assert changed_tree.nodes == tuple(node.facts() for node in run.runner.tree.nodes)


def test_the_skill_that_runs_goes_on_in_place():
    run = Reloaded(SLOWER)
    first = [
        event
        for event in run.events
        if isinstance(event, NodeChanged) and event.path == "turn/First"
    ]
    assert [(event.status, event.starts) for event in first if event.status != "INVALID"] == [
        ("RUNNING", 1),
        ("SUCCESS", 1),
    ]


def test_an_input_inside_a_subtree_is_taken_over():
    text = changed("{duration: 100 ms, turned", "{duration: 300 ms, turned")
    run = Reloaded(text)
    assert run.ticks("turn/part/Third") >= 15


def test_comments_and_layout_are_taken_over_without_a_change_of_any_node():
    run = Reloaded(
        "# slower soon\n" + changed('      retry: "{tries}"', '      retry:   "{tries}"   # twice')
    )
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
        ("name: First", "name: Other", "tree.yaml:9: the children of turn have changed before the place"),
        ("      name: First", "      name: First\n      timeout: 5 s", "tree.yaml:9: the children of turn have"),
        ("    - Turn: {duration: 100 ms}\n      name: First\n", "", "tree.yaml:9: the children of turn have changed"),
        ("  sequence:\n", "  sequence:\n    - wait: 1 s\n", "tree.yaml:9: the children of turn have changed before"),
        ("  sequence:\n", "  reactive_sequence:\n", "tree.yaml:8: type or name of turn has changed, but this node"),
        ("tree: turn", "tree: twist", "tree.yaml:8: the whole tree has another form"),
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
    text = SLOWER.replace("name: First", "name: Other")
    run = Reloaded(text)
    assert isinstance(run.refused, ReloadRefusedError)
    assert run.acts == []
    assert run.ticks("turn/Second") < 10


@pytest.mark.parametrize(
    ("written", "why"), [("3 kg", "error"), ("[", "error"), ("400 ms, speed: 2", "speed")]
)
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
    runner, *_ = make(
        TEXT, SKILLS, script, go_on=True, reread=lambda: SLOWER, takeover=FileTakeover
    )
    assert runner.run().outcome == "success"
    assert refused == ["the run is not paused", "the run still comes to rest"]


def test_a_request_that_the_pause_has_outlived_is_recorded_as_too_late():
    def act(runner, _cell):
        if runner.state is RunState.PAUSED:
            runner.resume(runner.pause_number)
            runner.reload(runner.pause_number, "ada")

    script = dict.fromkeys(range(4, 400), act)
    script[3] = lambda runner, _cell: runner.pause()
    runner, _, events = make(TEXT, SKILLS, script, reread=lambda: SLOWER, takeover=FileTakeover)
    assert runner.run().outcome == "success"
    late = [
        event.detail
        for event in events
        if isinstance(event, OperatorActed) and event.action == "too_late"
    ]
    assert len(late) == 1
    assert late[0].startswith("reload ---")
    assert late[0].endswith("pause already over")
    assert not any(
        isinstance(event, OperatorActed) and event.action in ("reload", "change")
        for event in events
    )


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
    runner, _, events = make(TEXT, SKILLS, script, reread=lambda: current[0], takeover=FileTakeover)
    assert runner.run().outcome == "success"
    before, after = (e.difference.splitlines()[3:] for e in events if isinstance(e, TreeChanged))
    assert before == ["-    - Turn: {duration: 100 ms}", "+    - Turn: {duration: 400 ms}"]
    assert after == ["-    - Turn: {duration: 400 ms}", "+    - Turn: {duration: 100 ms}"]


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
    runner, _, events = make(TEXT, SKILLS, script, reread=lambda: SLOWER, takeover=FileTakeover)
    assert runner.run().outcome == "success"
    assert refused == ["the run is in pause 1; the request names pause 7"]
    assert any(
        isinstance(e, OperatorActed) and (e.who, e.action) == ("Ada", "reload") for e in events
    )


@pytest.mark.parametrize(
    ("old", "new", "ran"),
    [
        ("    - part: {}", "    - part: {}\n    - Turn: {duration: 40 ms}\n      name: New", "First Second Third New"),
        (SECOND, f"    - Turn: {{duration: 40 ms}}\n      name: New\n{SECOND}", "First New Second Third"),
        ("    - part: {}\n", "", "First Second"),
        ("name: Second", "name: Other", "First Other Third"),
        (f"{RETRIED}\n    - part: {{}}", f"    - part: {{}}\n{RETRIED}", "First Third Second"),
        ("    - part: {}", "    - fallback:\n        - part: {}\n        - wait: 1 s", "First Second Third"),
        ("    - part: {}", "    - part: {}\n      repeat: 2", "First Second Third Third"),
        ("      retry: \"{tries}\"", "      retry: 5\n      timeout: 9 s", "First Second Third"),
        ("      name: Third", "      name: Third\n      retry: 2", "First Second Third"),
    ],
)  # fmt: skip
def test_nodes_that_have_not_begun_are_those_of_the_changed_file(old, new, ran):
    run = Reloaded(changed(old, new))
    assert run.refused is None
    assert run.outcome == "success"
    assert run.ran == ran.split()
    assert run.starts("turn/First") == 1


class ChangedThenReloaded(Reloaded):
    """Before the reload the operator has changed the duration of Third."""

    changed = False

    def look(self, runner, cell):
        if runner.state is RunState.PAUSED and not self.changed:
            self.changed = True
            runner.change("turn/part/Third", "duration", "400 ms", "ada")
        else:
            super().look(runner, cell)


THIRD = '      Turn: {duration: 100 ms, turned: "{a}"}\n      name: Third'


@pytest.mark.parametrize(
    ("old", "new", "path", "dropped"),
    [
        ("    - part: {}", "    - part: {}\n      timeout: 9 s", "turn/part/Third", ""),
        (THIRD, THIRD.replace("100 ms", "200 ms"), "turn/part/Third", "Third.duration"),
        (THIRD, THIRD.replace("name: Third", "name: Other"), "turn/part/Other", "Third.duration"),
    ],
)
def test_a_reload_keeps_what_the_operator_has_changed_or_names_what_it_drops(
    old, new, path, dropped
):
    run = ChangedThenReloaded(changed(old, new))
    assert (run.refused, run.outcome) == (None, "success")
    assert (run.ticks(path) >= 19) == (not dropped)
    (detail,) = (detail for _, action, detail in run.acts if action == "reload")
    assert detail.endswith(f"dropped: {dropped}") if dropped else "dropped" not in detail


def test_a_parameter_may_change_unless_a_node_that_has_begun_uses_it():
    once = changed('      retry: "{tries}"', '      retry: "{tries}"\n      delay: "{long}"')
    run = Reloaded(once.replace("default: 1 s", "default: 300 ms"))
    assert run.refused is None
    assert run.ticks("turn/Second:delay") >= 19

    text = TEXT.replace(
        "duration: 100 ms}\n      name: First", 'duration: "{long}"}\n      name: First'
    )
    run = Reloaded(text.replace("default: 1 s", "default: 2 s"), before=text)
    assert "tree.yaml:9: duration of First has changed, but this node has started" in str(
        run.refused
    )


TRIES = """
pomona: 1
tree: tries
root:
  retry: 3
  sequence:
    - Turn: {duration: 100 ms}
      name: First
    - Turn: {duration: 100 ms}
      name: Second
    - check: "retry.attempt == 2"
      name: Look
"""


def test_a_new_node_sees_the_counter_of_a_retry_that_runs():
    text = TRIES.replace('retry.attempt == 2"', 'retry.attempt == 3"')
    run = Reloaded(text, before=TRIES)
    assert run.outcome == "success"
    assert run.starts("tries/First") == 3


def test_a_skill_that_ran_in_the_pass_before_keeps_the_number_of_its_starts():
    text = TRIES.replace("100 ms}\n      name: Second", "120 ms}\n      name: Second")
    run = Reloaded(
        text.replace("name: Look", "name: Look again"), before=TRIES, pause_at=16
    )  # in the second try
    assert run.refused is None
    assert run.starts("tries/Second") == 2


ONCE = """
pomona: 1
tree: once
root:
  repeat: 2
  sequence:
    - Turn: {duration: 40 ms}
      name: First
      run_once: true
    - Turn: {duration: 100 ms}
      name: Second
"""


def test_a_node_that_runs_once_in_a_run_is_not_made_new():
    run = Reloaded(
        ONCE.replace("40 ms", "60 ms"), before=ONCE, pause_at=12
    )  # skipped in the second round
    assert isinstance(run.refused, ReloadRefusedError)
    assert run.starts("once/First") == 1


def test_at_a_breakpoint_the_node_that_is_held_gets_new_inputs_and_later_nodes_are_new():
    text = SLOWER.replace(
        "    - part: {}", "    - part: {}\n    - Turn: {duration: 40 ms}\n      name: New"
    )
    run = Reloaded(text, held="turn/Second")
    assert run.refused is None
    assert run.ran == ["First", "Second", "Third", "New"]
    assert run.ticks("turn/Second") >= 20
    assert run.starts("turn/Second") == 1


def test_a_breakpoint_stays_at_a_node_that_is_made_new():
    paused = []

    def act(runner, _cell):
        if runner.state is not RunState.PAUSED:
            return
        paused.append([event.path for event in events if isinstance(event, NodeChanged)][-1])
        if len(paused) == 1:
            runner.reload(runner.pause_number)
        runner.resume(runner.pause_number)

    def begin(runner, _cell):
        runner.break_at("turn/part", "before")
        runner.pause()

    script = {3: begin, **dict.fromkeys(range(4, 400), act)}
    text = changed("    - part: {}", "    - part: {}\n      timeout: 5 s")
    runner, _, events = make(TEXT, SKILLS, script, reread=lambda: text, takeover=FileTakeover)
    assert runner.run().outcome == "success"
    assert len(paused) == 2


def test_a_skill_that_cannot_be_prepared_is_refused():
    class Weighty(Turn):
        def prepare(self):
            raise OSError("no weights")

    skills = Registry({"Turn": Turn, "Weighty": Weighty})
    run = Reloaded(changed("    - part: {}", "    - Weighty: {duration: 40 ms}"), skills=skills)
    assert "Weighty cannot be prepared: no weights" in str(run.refused)
    assert run.ran == ["First", "Second", "Third"]


def test_a_question_of_the_changed_file_is_asked():
    asked = []

    def act(runner, _cell):
        if runner.state is RunState.PAUSED:
            if not asked:
                asked.append("")
                runner.reload(runner.pause_number)
            runner.resume(runner.pause_number)
        for path, question in runner.questions.items():
            if question.open:
                asked.append(path)
                runner.answer(path, question.starts, "yes")

    script = {3: lambda runner, _cell: runner.pause(), **dict.fromkeys(range(4, 400), act)}
    text = changed("    - part: {}", "    - ask: Go on?\n      name: Ask")
    runner, *_ = make(
        TEXT, SKILLS, script, reread=lambda: text, takeover=FileTakeover, attended=True
    )
    assert runner.run().outcome == "success"
    assert asked == ["", "turn/Ask"]


@pytest.mark.parametrize("how", ["reload", "change"])
def test_an_approval_holds_for_the_inputs_that_it_was_given_for(how: str):
    text = changed("      name: First\n", "      name: First\n      approve: true\n")
    later = text.replace("100 ms", "900 ms")
    place = "turn/First:approve"
    answers: list[int] = []
    looks = itertools.count()

    def look(runner, _cell):
        asked = runner.questions.get(place)
        if not answers and asked is not None and asked.open:
            if runner.state is not RunState.PAUSED:
                runner.pause("ada")
                return
            answers.append(asked.starts)
            runner.answer(place, asked.starts, "approve", "ada")
        elif answers == [1] and runner.state is RunState.PAUSED:
            answers.append(0)
            if how == "reload":
                runner.reload(runner.pause_number, "ada")
            else:
                runner.change("turn/First", "duration", "900 ms", "ada")
            runner.resume(runner.pause_number, "ada")
        elif next(looks) > 30:
            runner.safe_stop("nobody answers again")

    script = dict.fromkeys(range(1, 400), look)
    runner, _, events = make(
        text, SKILLS, script, reread=lambda: later, takeover=FileTakeover, attended=True
    )
    runner.run()
    assert answers == [1, 0]
    started = {event.path for event in events if isinstance(event, NodeChanged)}
    assert "turn/First" not in started
