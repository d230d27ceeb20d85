"""The drawing after a reload: recorded differences give the text that the run went on with."""

from __future__ import annotations

import difflib
from pathlib import Path

from hypothesis import given, strategies as st
from recorded_events import started

from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import TreeChanged
from pomona.tools.dashboard.redrawing import patched, redrawing

LINES = st.lists(
    st.sampled_from(["", "a", "- b", "+ c", "--- d", "+++ d", "@@ -1 +1 @@", "e: 1"]), max_size=12
)
TREE = "pomona: 1\ntree: pick\nroot:\n  sequence:\n    - Look: {}\n    - Grasp: {}\n"


def difference(old: list[str], new: list[str], name: str) -> str:
    return "\n".join(difflib.unified_diff(old, new, name, name, n=0, lineterm=""))


@given(LINES, LINES, LINES)
def test_a_difference_leads_from_the_old_text_to_the_new_one_and_leaves_other_files_alone(
    old: list[str], new: list[str], other: list[str]
) -> None:
    both = f"{difference(other, new, 'other.yaml')}\n{difference(old, new, 'pick.yaml')}"
    assert patched("".join(f"{line}\n" for line in old), both, "pick.yaml").splitlines() == new


def test_the_picture_has_the_nodes_of_the_moment(tmp_path: Path) -> None:
    later = TREE.replace("Grasp", "Weigh").replace(
        "    - Look: {}\n", "    - Look: {}\n    - Look: {}\n"
    )
    recorder = Recorder(tmp_path)
    recorder.on_event(started(tree_text=TREE, tree_path="pick.yaml"))
    recorder.on_event(
        TreeChanged(2.0, 100, (), difference(TREE.splitlines(), later.splitlines(), "pick.yaml"))
    )
    recorder.close()
    at_first, before, after = (redrawing(tmp_path, t) for t in (0.0, 1.9, 2.0))
    assert at_first is not None
    assert after is not None
    assert before == at_first
    assert (at_first.count(">Look<"), at_first.count(">Weigh<")) == (1, 0)
    assert (after.count(">Look<"), after.count(">Weigh<"), after.count(">Grasp<")) == (2, 1, 0)


def test_a_damaged_difference_draws_the_readable_part(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    recorder.on_event(started(tree_text=TREE, tree_path="pick.yaml"))
    recorder.on_event(TreeChanged(2.0, 100, (), "--- pick.yaml\n@@ -900,3 +1,999999 @@\n+["))
    recorder.close()
    assert redrawing(tmp_path, 3.0) is not None
