"""The drawing of a record's tree has its nodes in the order of the run's, so that the page can colour them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pomona.executive.execute import RunOrder, execute
from pomona.executive.running.events import Event, RunStarted
from pomona.tools.dashboard.pages import drawing

TREE = """pomona: 1
tree: demo
root:
  sequence:
    - wait: 10 ms
      name: A pause
      timeout: 5 s
      retry: 2
    - part: {}
    - fallback:
        - check: "false"
        - parallel:
            - wait: 10 ms
            - wait: 20 ms
      retry: 2
      on_failure: {wait: 10 ms}
subtrees:
  part:
    root:
      sequence:
        - wait: 10 ms
"""


def test_boxes_follow_the_rows_of_the_page(tmp_path: Path) -> None:
    (tmp_path / "tree.yaml").write_text(TREE, encoding="utf-8")
    drawn = drawing(tmp_path)
    assert drawn is not None
    boxes = [
        title.split("\n")[0] for title in re.findall(r"<g><title>(.*?)</title>", drawn, re.DOTALL)
    ]
    events: list[Event] = []
    execute(RunOrder(tmp_path / "tree.yaml", tmp_path / "cell.yaml", dry=True), [events.append])
    nodes: list[Any] = next(list(event.nodes) for event in events if isinstance(event, RunStarted))
    rows = [node["name"] for node in nodes if not node["path"].endswith(f":{node['kind']}")]
    assert [box.partition(" (")[0] for box in boxes][1:] == rows[
        1:
    ]  # the first row has the tree's own name
    assert rows[0] == "demo"


def test_a_record_without_a_tree_or_with_a_link_has_no_drawing(tmp_path: Path) -> None:
    assert drawing(tmp_path) is None
    (tmp_path / "real.yaml").write_text(TREE, encoding="utf-8")
    (tmp_path / "tree.yaml").symlink_to(tmp_path / "real.yaml")
    assert drawing(tmp_path) is None
