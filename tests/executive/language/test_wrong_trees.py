"""Wrong trees as people write them: the first line of the message names the change, and `--fix` makes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import pytest

from pomona.executive.cli import main
from pomona.executive.files import find_tree


class WrongTree(NamedTuple):
    """A wrong tree, the first line of its message from the place on, and whether `--fix` mends all of it."""

    text: str
    first_line: str
    is_mended: bool = False


TREES = {
    "timeout_at_col6": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe}
     timeout: 5 s
    - MoveTo: {pose: home}
""",
        "6:6: error[yaml]: 'timeout' is at column 6; modifiers of MoveTo start at column 7, under the M",
        is_mended=True,
    ),
    "modifier_outside": WrongTree(
        """\
pomona: 1
tree: t
root:
   sequence:
     - MoveTo: {pose: observe}
  retry: 3
""",
        "6:3: error[yaml]: 'retry' is at column 3; modifiers of sequence start at column 4, under the s",
        is_mended=True,
    ),
    "retries": WrongTree(
        """\
pomona: 1
tree: t
root:
  MoveTo: {pose: observe}
  retries: 3
""",
        "5:3: error[unknown-key]: no modifier named 'retries'; did you mean 'retry'?",
        is_mended=True,
    ),
    "timeout_as_port": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo:
        pose: observe
        timeout: 5 s
""",
        "7:9: error[unknown-port]: 'timeout' is a modifier: write it beside MoveTo, at column 7, and not in it",
        is_mended=True,
    ),
    "retry_as_node": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - retry: 3
    - MoveTo: {pose: observe}
""",
        "5:7: error[no-type]: 'retry' is a modifier and no node of its own; write it beside the node that "
        "it belongs to, at the same column",
    ),
    "detektion": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detektion: "{detection}"}
    - Refine: {detection: "{detection}", measured: "{measured}"}
    - check: "{measured.inlier_ratio} > 0.6"
""",
        "5:30: error[unknown-port]: Detect has no port 'detektion'; did you mean 'detection'?",
        is_mended=True,
    ),
    "Sequence": WrongTree(
        """\
pomona: 1
tree: t
root:
  Sequence:
    - MoveTo: {pose: observe}
""",
        "4:3: error[unknown-type-of-node]: no node is named 'Sequence'; did you mean 'sequence'?",
        is_mended=True,
    ),
    "negative_timeout": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{detection}"}
    - Refine: {detection: "{detection}", measured: "{measured}"}
      timeout: -5 s
    - check: "{measured.inlier_ratio} > 0.6"
""",
        "7:16: error[range]: timeout is at least 0 s, -5 s is below",
    ),
    "plan_needs_to": WrongTree(
        """\
pomona: 1
tree: t
root:
  Plan: {path: "{path}"}
""",
        "4:3: error[missing-port]: Plan needs 'to', a grasp_candidates: SampleGrasp and SampleHook write one; write "
        'to: "{candidates}"',
    ),
    "approach_needs_the_grasp_that_a_plan_for_these_candidates_gives": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{detection}"}
    - Refine: {detection: "{detection}", measured: "{measured}"}
    - SampleGrasp: {around: "{measured}", candidates: "{candidates}"}
    - Approach: {}
""",
        "8:7: error[missing-port]: Approach needs 'grasp', a grasp: Plan and Intercept write one; write "
        'grasp: "{grasp}"',
    ),
    "nothing_writes_map": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe, map: "{map}"}
""",
        "5:38: error[unknown-port]: nothing writes 'map' and nothing declares it; UpdateMap writes one: "
        'put it before this node, with map: "{map}"',
    ),
    "field_width": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{detection}"}
    - Refine: {detection: "{detection}", measured: "{measured}"}
    - check: "{measured.width} < 90 mm"
""",
        "7:16: error[unknown-field]: a measured_fruit has no field 'width'; it has mu (ratio), sigma "
        "(length), inlier_ratio (ratio), residual (length), dimensions (array of 3 lengths), fruit "
        "(fruit_model), contour (ndarray), frame (frame) and 10 more",
    ),
    "dimensions": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{detection}"}
    - Refine: {detection: "{detection}", measured: "{measured}"}
    - check: "{measured.dimensions} < 90 mm"
""",
        "7:16: error[expression-type]: '<' compares numbers, this is an array of 3 lengths; take one "
        "element: dimensions[0]",
    ),
    "perceive": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - perceive: {}
""",
        "5:7: error[unknown-type-of-node]: nothing is named 'perceive'; declare the subtree: 'subtrees: "
        "{perceive: {root: …}}', or with 'file: other.yaml' for a tree",
    ),
    "too_heavy": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{detection}"}
    - Refine: {detection: "{detection}", measured: "{measured}"}
      retry: 3
      retry_if: "failure.code == TOO_HEAVY"
    - check: "{measured.inlier_ratio} > 0.6"
""",
        "8:34: error[unknown-code]: Refine cannot fail with TOO_HEAVY; it can with AT_BOUND, BAD_VALUE, "
        "DEPTH_MISMATCH, NOT_ITS_SHAPE, NO_DEPTH, POSE_MISMATCH, RENDER_FAILED, SIZE_OUT_OF_RANGE, "
        "TOO_FEW_INLIERS",
    ),
    "btcpp": WrongTree(
        """\
pomona: 1
tree:
  Sequence:
    - MoveTo: {pose: observe}
""",
        "2:1: error[shape]: 'tree' is the tree's name: write 'tree: my_tree', and its nodes below 'root:'",
        is_mended=True,
    ),
    "height": WrongTree(
        """\
pomona: 1
tree: t
root:
  Lift: {height: 150 m}
""",
        "4:18: error[range]: Lift.height is at most 1 m, 150 m is above",
    ),
    "pose_typo": WrongTree(
        """\
pomona: 1
tree: t
root:
  MoveTo: {pose: obsverve}
""",
        "4:18: error[unfit]: MoveTo: the cell 'sim' has no pose 'obsverve'; did you mean 'observe'?",
        is_mended=True,
    ),
    "fruit_typo": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: aple, detection: "{detection}"}
    - check: "{detection.score} > 0.5"
""",
        "5:23: error[unfit]: Detect: no fruit named 'aple'; did you mean 'apple'? "
        "the catalogue has apple, lemon, orange, peach, pear, tomato",
    ),
    "item_too_deep": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe}
      - MoveTo: {pose: home}
""",
        "6:7: error[yaml]: this item is at column 7; items of sequence start at column 5",
        is_mended=True,
    ),
    "item_too_shallow": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe}
   - MoveTo: {pose: home}
""",
        "6:4: error[yaml]: this item is at column 4; items of sequence start at column 5",
        is_mended=True,
    ),
    "modifier_too_deep_flow": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe}
        timeout: 5 s
""",
        "6:9: error[yaml]: 'timeout' is at column 9; modifiers of MoveTo start at column 7, under the M",
        is_mended=True,
    ),
    "modifier_at_dash": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe}
    timeout: 5 s
    - MoveTo: {pose: home}
""",
        "6:5: error[yaml]: 'timeout' is at column 5; modifiers of MoveTo start at column 7, under the M; "
        "those of sequence at column 3",
    ),
    "port_beside": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo:
      pose: observe
""",
        "6:7: error[unknown-key]: 'pose' is no modifier; a port of MoveTo starts at column 9",
        is_mended=True,
    ),
    "no_dash": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    MoveTo: {pose: observe}
    Beep: {}
""",
        "5:5: error[shape]: 'sequence' takes a list of nodes, this is a mapping; start each child with '- '",
    ),
    "wire_no_quotes": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{detection}"}
    - Refine: {detection: {detection}, measured: "{measured}"}
    - check: "{measured.inlier_ratio} > 0.6"
""",
        '6:27: error[shape]: Refine.detection is wired without quotes; write "{detection}"',
        is_mended=True,
    ),
    "no_unit": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe}
      timeout: 5
""",
        "6:16: error[value]: timeout: '5' lacks a unit: a time is given in s, ms, us, min, h",
    ),
    "retry_in_block_skill": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - retry:
        MoveTo: {pose: observe}
""",
        "5:7: error[no-type]: 'retry' is a modifier and no node of its own; write it beside the node that "
        "it belongs to, at the same column",
    ),
    "tab": WrongTree(
        """\
pomona: 1
tree: t
root:
\tMoveTo: {pose: observe}
""",
        "4:1: error[tab]: a tab indents this line, and YAML indents with spaces only; put spaces in its "
        "place; your editor can show it",
    ),
    "colon_missing_space": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo:{pose: observe}
""",
        "5:7: error[yaml]: a space is missing behind 'MoveTo:'",
        is_mended=True,
    ),
    "unclosed_brace": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe
    - MoveTo: {pose: home}
""",
        "5:15: error[yaml]: the { that opens here is not closed: add } at the end of the line",
        is_mended=True,
    ),
    "unclosed_quote": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{detection}}
    - MoveTo: {pose: home}
""",
        '5:41: error[yaml]: the " that opens here is not closed: add " behind {detection}',
        is_mended=True,
    ),
    "root_list": WrongTree(
        """\
pomona: 1
tree: t
root:
  - MoveTo: {pose: observe}
  - MoveTo: {pose: home}
""",
        "4:3: error[shape]: a node is a mapping, this is a list; write 'sequence:' above it, and the list "
        "two columns further right",
    ),
    "RetryUntilSuccessful": WrongTree(
        """\
pomona: 1
tree: t
root:
  RetryUntilSuccessful:
    num_attempts: 3
    MoveTo: {pose: observe}
""",
        "4:3: error[unknown-skill]: no skill named 'RetryUntilSuccessful'; other libraries' "
        "RetryUntilSuccessful is the modifier 'retry' here",
    ),
    "on_failure_without": WrongTree(
        """\
pomona: 1
tree: t
root:
  MoveTo: {pose: observe}
  on_failure:
    MoveTo: {pose: home}
""",
        "5:3: error[missing-key]: 'on_failure' means nothing without 'retry'; add 'retry: …' beside it",
    ),
    "plain_value_then_mod": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - wait: 2 s
        timeout: 5 s
""",
        "6:9: error[yaml]: 'timeout' is at column 9; modifiers of wait start at column 7, under the w",
        is_mended=True,
    ),
    "missing_colon": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence
    - MoveTo: {pose: observe}
""",
        "4:3: error[yaml]: a colon is missing behind 'sequence': write 'sequence: …'",
        is_mended=True,
    ),
    "fruit_twice_key": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe}
  sequence:
    - MoveTo: {pose: home}
""",
        "6:3: error[duplicate-key]: 'sequence' is given twice, first in line 4: keep one of them",
    ),
    "retry_flow": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: observe, retry: 3}
""",
        "5:31: error[unknown-port]: 'retry' is a modifier: write it beside MoveTo, at column 7, and not in it",
        is_mended=True,
    ),
    "delay_alone": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - delay: 2 s
    - MoveTo: {pose: observe}
""",
        "5:7: error[no-type]: 'delay' is a modifier and no node of its own; write it beside the node that "
        "it belongs to, at the same column",
    ),
    "repeat_node": WrongTree(
        """\
pomona: 1
tree: t
root:
  repeat:
    sequence:
      - MoveTo: {pose: observe}
""",
        "4:3: error[no-type]: 'repeat' is a modifier and no node of its own; write it beside the node that "
        "it belongs to, at the same column",
    ),
    "refine_typo_input": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{detection}"}
    - Refine: {detektion: "{detection}", measured: "{measured}"}
    - check: "{measured.inlier_ratio} > 0.6"
""",
        "6:16: error[unknown-port]: Refine has no port 'detektion'; did you mean 'detection'?",
        is_mended=True,
    ),
    "no_root": WrongTree(
        """\
pomona: 1
tree: t
sequence:
  - MoveTo: {pose: home}
retry: 2
""",
        "3:1: error[missing-key]: 'sequence' is not below 'root'; "
        "write 'root:' above it, and the node two columns further right",
        is_mended=True,
    ),
    "version2": WrongTree(
        """\
pomona: 2
tree: t
root:
  MoveTo: {pose: home}
""",
        "1:9: error[version]: this Pomona reads version 1 of tree files; write 'pomona: 1'",
    ),
    "xml": WrongTree(
        """\
<root BTCPP_format="4"><BehaviorTree ID="a"><AlwaysSuccess/></BehaviorTree></root>""",
        "1:1: error[xml]: this is XML, not a tree file; 'pomona import t.yaml' makes a tree file of it",
    ),
    "anchor": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - &a MoveTo: {pose: home}
    - *a
""",
        "6:7: error[alias]: YAML aliases (*) are not allowed in a tree file; "
        "write the value again, or make it a constant or a subtree",
    ),
    "dash_no_space": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    -MoveTo: {pose: home}
    -MoveTo: {pose: observe}
""",
        "5:5: error[yaml]: a space is missing behind '-'",
        is_mended=True,
    ),
    "trailing_comma": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - MoveTo: {pose: home},
    - MoveTo: {pose: observe}
""",
        "5:27: error[yaml]: this ',' is one too many: delete it",
        is_mended=True,
    ),
    "missing_comma": WrongTree(
        """\
pomona: 1
tree: t
root:
  Detect: {fruit: apple detection: '{detection}'}
""",
        "4:25: error[yaml]: a comma is missing before 'detection'",
        is_mended=True,
    ),
    "extra_brace": WrongTree(
        """\
pomona: 1
tree: t
root:
  Detect: {fruit: apple}}
""",
        "4:25: error[yaml]: this '}' is one too many: delete it",
        is_mended=True,
    ),
    "type_key": WrongTree(
        """\
pomona: 1
tree: t
root:
  type: sequence
  children:
    - MoveTo: {pose: home}
""",
        "4:3: error[no-type]: the type is the node's first key: write 'sequence:' and its children or ports below",
    ),
    "pytrees": WrongTree(
        """\
pomona: 1
tree: t
root:
  Selector:
    - MoveTo: {pose: home}
    - MoveTo: {pose: observe}
""",
        "4:3: error[unknown-type-of-node]: no node is named 'Selector'; did you mean 'fallback'?",
        is_mended=True,
    ),
    "sleep": WrongTree(
        """\
pomona: 1
tree: t
root:
  sleep: 5 s
""",
        "4:3: error[unknown-type-of-node]: no node is named 'sleep'; did you mean 'wait'?",
        is_mended=True,
    ),
    "inverter": WrongTree(
        """\
pomona: 1
tree: t
root:
  inverter:
    MoveTo: {pose: home}
""",
        "4:3: error[unknown-type-of-node]: nothing is named 'inverter'; "
        "other libraries' inverter is the modifier 'invert' here",
    ),
    "action_id": WrongTree(
        """\
pomona: 1
tree: t
root:
  Action: {ID: MoveTo, pose: home}
""",
        "4:3: error[unknown-skill]: no skill named 'Action'; write the node's own name instead: 'MoveTo: {…}'",
    ),
    "port_list": WrongTree(
        """\
pomona: 1
tree: t
root:
  MoveTo: [home]
""",
        "4:11: error[shape]: MoveTo takes its ports as a mapping, this is a list; write 'MoveTo: {port: value}'",
    ),
    "retry_no_number": WrongTree(
        """\
pomona: 1
tree: t
root:
  MoveTo: {pose: home}
  retry:
""",
        "5:9: error[value]: retry: nothing stands here; an int is needed",
    ),
    "cond_and": WrongTree(
        """\
pomona: 1
tree: t
parameters: {n: {type: int, default: 3}}
root:
  check: '{n} > 3 && {n} < 5'
""",
        "5:19: error[expression]: '&&' means nothing in an expression; write 'and'",
    ),
    "dollar_param": WrongTree(
        """\
pomona: 1
tree: t
parameters: {p: {type: text, default: home}}
root:
  MoveTo: {pose: '${p}'}
""",
        "5:19: error[expression]: '$' means nothing in an expression; write \"{name}\" without it",
    ),
    "subtree_type": WrongTree(
        """\
pomona: 1
tree: t
root:
  go: {pose: home}
subtrees:
  go:
    in: {pose: str}
    root:
      MoveTo: {pose: '{pose}'}
""",
        "7:16: error[unknown-type]: no type named 'str'; write 'text'",
        is_mended=True,
    ),
    "parameter_as_value": WrongTree(
        """\
pomona: 1
tree: t
parameters: {n: 3}
root:
  check: '{n} > 2'
""",
        "3:17: error[unknown-type]: no type named '3'; if it is the value, write {type: int, default: 3}",
    ),
    "bool_yes": WrongTree(
        """\
pomona: 1
tree: t
root:
  MoveTo: {pose: home}
  disabled: yes
""",
        "5:13: error[value]: disabled: 'yes' is not a bool; write true or false",
    ),
    "no_braces": WrongTree(
        """\
pomona: 1
tree: t
parameters: {n: {type: int, default: 3}}
root:
  check: n > 2
""",
        "5:10: error[expression-type]: '>' compares numbers, this is a text; write \"{n}\" to read a port",
    ),
    "subtrees_alone": WrongTree(
        """\
pomona: 1
tree: t
subtrees:
  look: {root: {wait: 1 s}}
""",
        "1:1: error[missing-key]: the file has no 'root'; write 'root:' and the first node under it",
    ),
    "empty": WrongTree(
        "",
        "1:1: error[empty]: the file is empty, a tree file is a mapping; begin it with 'pomona: 1'",
    ),
    "curved_quotes": WrongTree(
        """\
pomona: 1
tree: t
root:
  - Detect: {fruit: apple, detection: \u201c{d}\u201d}
""",
        '4:40: error[yaml]: curved quotes do not quote in YAML; write straight ones: "{name}"',
    ),
    "decimal_comma": WrongTree(
        """\
pomona: 1
tree: t
root:
  wait: 1,5 s
""",
        "4:9: error[value]: wait: '1,5 s' is not a time: write '1.5 s', with a point",
    ),
    "speed_in_percent": WrongTree(
        """\
pomona: 1
tree: t
root:
  MoveTo: {pose: observe}
  speed: 50
""",
        "5:10: error[range]: speed is at most 1, 50 is above; write '50 %'",
    ),
    "field_without_braces": WrongTree(
        """\
pomona: 1
tree: t
root:
  sequence:
    - Detect: {fruit: apple, detection: "{d}"}
    - wait: 1 s
      when: "d.score > 0.5"
""",
        "7:14: error[unknown-field]: a text has no field 'score'; write \"{d.score}\" to read a port",
    ),
    "error_before_warning": WrongTree(
        """\
pomona: 1
tree: t
root:
  fallback:
    - Detect: {fruit: apple, detection: "{d}"}
    - wait: 1 s
      when: failure.code == NOTHING_FOUDN
""",
        "7:29: error[unknown-code]: Detect cannot fail with NOTHING_FOUDN; did you mean 'NOTHING_FOUND'?",
        is_mended=True,
    ),
}


@pytest.mark.parametrize("name", TREES)
def test_the_first_line_names_the_change(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree, path = TREES[name], tmp_path / "t.yaml"
    path.write_text(tree.text)
    assert main(["check", str(path)]) == 2
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].removeprefix(f"{path}:") == tree.first_line
    errors = [line for line in lines if ": error[" in line]
    assert len(errors) == (2 if name == "plan_needs_to" else 1), "one mistake has one finding"


@pytest.mark.parametrize("name", TREES)
def test_fix_makes_the_change_that_a_hint_names(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree, path = TREES[name], tmp_path / "t.yaml"
    path.write_text(tree.text)
    status = main(["check", "--fix", str(path)])
    told = capsys.readouterr().err
    assert (status == 0) == tree.is_mended
    assert (path.read_text() != tree.text) == bool(told) == tree.is_mended
    again = path.read_text()
    assert main(["check", "--fix", str(path)]) == status
    assert path.read_text() == again


def test_there_are_thirty_of_them() -> None:
    assert len({tree.text for tree in TREES.values()}) >= 30


def test_fmt_explains_a_wrong_indentation_in_the_same_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "t.yaml"
    path.write_text(TREES["timeout_at_col6"].text)
    assert main(["fmt", str(path)]) == 2
    told = capsys.readouterr().err.splitlines()
    assert told[0] == f"{path}:{TREES['timeout_at_col6'].first_line}"
    assert path.read_text() == TREES["timeout_at_col6"].text


def test_fix_keeps_line_endings_and_mends_several_mistakes_one_after_the_other(
    tmp_path: Path,
) -> None:
    path = tmp_path / "t.yaml"
    path.write_bytes(
        b"pomona: 1\r\ntree: t\r\nroot:\r\n  Sequence:\r\n    - MoveTo: {pose: obsrve}\r\n     retries: 2\r\n"
    )
    assert main(["check", "--fix", "--cell", "sim", str(path)]) == 0
    wanted = b"pomona: 1\r\ntree: t\r\nroot:\r\n  sequence:\r\n    - MoveTo: {pose: observe}\r\n      retry: 2\r\n"
    assert path.read_bytes() == wanted


def test_a_tree_for_another_cell_is_checked_but_for_poses_and_fruit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "pick_for_plc"]) == 0  # it names its cell
    assert "no-device" not in capsys.readouterr().out
    nameless = tmp_path / "t.yaml"
    nameless.write_text(find_tree("pick_for_plc").read_text("utf-8").replace("cell: sim_plc\n", ""))
    assert main(["check", str(nameless)]) == 0
    told = capsys.readouterr().out
    assert "warning[no-device]: poses and fruit are not checked on the cell 'sim'" in told
    assert "--cell" in told


def test_a_cell_that_the_command_names_stands_for_one_that_the_tree_names_and_nobody_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = tmp_path / "t.yaml"
    tree.write_text("pomona: 1\ntree: t\ncell: nowhere\nroot:\n  succeed: {}\n")
    assert main(["check", str(tree), "--cell", "sim"]) == 0
    tree.write_text("pomona: 1\ntree: t\ncell: nowhere\nroot:\n  Sucked: {}\n")
    capsys.readouterr()
    assert main(["check", "--json", str(tree)]) == 2
    found = json.loads(capsys.readouterr().out)
    assert [(one["code"], one["line"], one["column"]) for one in found] == [
        ("no-cell", 3, 7),
        ("unknown-skill", 5, 3),
    ]


def test_a_file_in_utf_16_is_named_as_such(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "t.yaml"
    path.write_bytes("pomona: 1\n".encode("utf-16"))
    assert main(["check", str(path)]) == 2
    assert "it is UTF-16; save it as UTF-8" in capsys.readouterr().err
