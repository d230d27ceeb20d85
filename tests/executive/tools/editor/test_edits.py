"""Edits of tree files change the text where they name it, and nowhere else."""

from __future__ import annotations

import random
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from benchmarks.tree_edits import ODD, disturbed, judge, random_edit, refused, tree_texts
from pomona.executive.language import read
from pomona.tools.editor.edits import EditError, TreeEdit, apply, edit_of, nodes

FOLDER = Path(__file__).resolve().parents[4]
HEAD = "pomona: 1\ntree: t\nroot:\n"
TREE = """\
pomona: 1
tree: t

root:
  sequence:
    # look first
    - Detect: {fruit: apple, detection: "{found}"}   # the nearest
      timeout: 5 s

    - fallback:
        - wait: 1 s
        - Beep: {}
      retry: 2
      on_failure:   # between
        wait: 2 s
"""


@cache
def texts() -> dict[str, str]:
    return tree_texts()


def edited(text: str, /, **message: Any) -> str:
    if "wrap_in" in message:
        message["in"] = message.pop("wrap_in")
    return apply(text, edit_of(message))


def changed(before: str, after: str) -> tuple[str, str]:
    """Return the lines that differ, without those at the beginning and at the end that are the same."""
    old, new = before.splitlines(True), after.splitlines(True)
    while old and new and old[0] == new[0]:
        old, new = old[1:], new[1:]
    while old and new and old[-1] == new[-1]:
        old, new = old[:-1], new[:-1]
    return "".join(old), "".join(new)


class TestOneEdit:
    def test_an_inserted_node_stands_on_lines_of_its_own(self):
        after = edited(TREE, do="insert", into="root", index=1, node="Beep: {}\nretry: 3")
        assert changed(TREE, after) == ("", "    - Beep: {}\n      retry: 3\n")

    def test_a_deleted_node_takes_the_comments_directly_above_it_along(self):
        after = edited(TREE, do="delete", node="root/0")
        assert changed(TREE, after)[0].startswith("    # look first\n    - Detect")
        assert after.startswith("pomona: 1\ntree: t\n\nroot:\n  sequence:\n\n    - fallback:\n")

    def test_a_moved_node_keeps_its_comments_and_is_indented_anew(self):
        after = edited(TREE, do="move", node="root/0", into="root/1", index=1)
        assert (
            after
            == """\
pomona: 1
tree: t

root:
  sequence:

    - fallback:
        - wait: 1 s
        # look first
        - Detect: {fruit: apple, detection: "{found}"}   # the nearest
          timeout: 5 s
        - Beep: {}
      retry: 2
      on_failure:   # between
        wait: 2 s
"""
        )

    def test_the_index_of_a_move_counts_without_the_node(self):
        after = edited(TREE, do="move", node="root/0", into="root", index=1)
        assert [n["type"] for n in nodes(after) if n["parent"] == "root"] == ["fallback", "Detect"]
        assert edited(TREE, do="move", node="root/0", into="root", index=0) == TREE

    def test_the_node_of_a_word_moves_with_the_comment_beside_the_word(self):
        after = edited(TREE, do="move", node="root/1/on_failure", into="root/1", index=0)
        assert changed(TREE, after)[1].startswith("        # between\n        - wait: 2 s\n")
        assert "on_failure" not in after

    def test_wrapping_and_unwrapping_gives_the_bytes_before(self):
        for word in ("sequence", "parallel", "fallback"):
            for node in ("root", "root/0", "root/1/0", "root/1/on_failure"):
                wrapped = edited(TREE, do="wrap", node=node, wrap_in=word)
                assert wrapped != TREE
                assert edited(wrapped, do="unwrap", node=node) == TREE

    def test_a_modifier_is_put_beside_a_node_and_outside_of_the_same_modifier(self):
        once = edited(TREE, do="wrap", node="root/0", wrap_in="retry")
        assert changed(TREE, once) == ("", "      retry: 3\n")
        twice = edited(once, do="wrap", node="root/0", wrap_in="retry")
        assert [(n["type"], [m["name"] for m in n["modifiers"]]) for n in nodes(twice)[1:3]] == [
            ("sequence", ["retry"]),
            ("Detect", ["timeout", "retry"]),
        ]

    def test_a_node_is_wrapped_in_a_condition(self):
        after = edited(
            TREE, do="wrap", node="root/1/1", wrap_in="if", value='"{found.score} > 0.5"'
        )
        assert (
            changed(TREE, after)[1]
            == '        - if: "{found.score} > 0.5"\n          then:\n            Beep: {}\n'
        )

    def test_a_wrapper_with_modifiers_is_not_unwrapped(self):
        with pytest.raises(EditError, match="its modifiers would be lost: retry, on_failure"):
            edited(TREE, do="unwrap", node="root/1")

    def test_a_copy_has_a_name_of_its_own(self):
        named = edited(TREE, do="rename", node="root/1", name="Try")
        after = edited(named, do="duplicate", node="root/1")
        assert [n["name"] for n in nodes(after) if n["parent"] == "root"] == ["", "Try", "Try 2"]

    def test_a_name_that_is_no_path_is_refused_and_an_empty_one_taken_away(self):
        with pytest.raises(EditError, match="not a valid name"):
            edited(TREE, do="rename", node="root", name="a/b")
        assert (
            edited(
                edited(TREE, do="rename", node="root", name="A"), do="rename", node="root", name=""
            )
            == TREE
        )

    def test_a_port_is_set_added_and_taken_away_in_its_braces(self):
        after = edited(TREE, do="set_port", node="root/0", port="fruit", value="lemon, ripe")
        assert changed(TREE, after)[1] == (
            '    - Detect: {fruit: "lemon, ripe", detection: "{found}"}   # the nearest\n'
        )
        after = edited(TREE, do="set_port", node="root/1/1", port="volume", value="3")
        assert changed(TREE, after)[1] == "        - Beep: {volume: 3}\n"
        assert edited(after, do="set_port", node="root/1/1", port="volume", value=None) == TREE

    def test_the_value_of_a_word_without_ports_is_a_port_of_its_name(self):
        after = edited(TREE, do="set_port", node="root/1/0", port="wait", value="3 s")
        assert changed(TREE, after) == ("        - wait: 1 s\n", "        - wait: 3 s\n")

    def test_a_modifier_is_taken_away_with_its_line(self):
        after = edited(TREE, do="set_modifier", node="root/0", modifier="timeout", value=None)
        assert changed(TREE, after) == ("      timeout: 5 s\n", "")

    def test_a_value_of_several_lines_stands_below_its_word(self):
        text = HEAD + "  Beep: {}\n  description: short\n"
        after = edited(
            text,
            do="set_modifier",
            node="root",
            modifier="description",
            value="|\n  two\n\n   lines",
        )
        assert after == HEAD + "  Beep: {}\n  description: |\n    two\n\n     lines\n"
        assert (
            edited(after, do="set_modifier", node="root", modifier="description", value="short")
            == text
        )
        text = HEAD + "  Beep: {}\n  retry: 2\n"
        after = edited(
            text, do="set_modifier", node="root", modifier="on_failure", value="wait: 1 s\nretry: 2"
        )
        assert after == text + "  on_failure:\n    wait: 1 s\n    retry: 2\n"

    def test_a_first_modifier_leaves_the_dash_and_the_comments_behind_it(self):
        text = (
            "pomona: 1\ntree: t\nroot:\n  sequence:\n    - retry: 3\n      # loud\n      Beep: {}\n"
        )
        after = edited(text, do="set_modifier", node="root/0", modifier="retry", value=None)
        assert after == "pomona: 1\ntree: t\nroot:\n  sequence:\n    # loud\n    - Beep: {}\n"

    def test_a_comment_is_written_where_the_old_one_stands(self):
        assert changed(TREE, edited(TREE, do="comment", node="root/1/on_failure", text="now")) == (
            "      on_failure:   # between\n",
            "      on_failure:   # now\n",
        )
        after = edited(TREE, do="comment", node="root/0", text="one\ntwo")
        assert changed(TREE, after) == (
            '    # look first\n    - Detect: {fruit: apple, detection: "{found}"}   # the nearest\n',
            '    # one\n    # two\n    - Detect: {fruit: apple, detection: "{found}"}\n',
        )
        assert "#" not in edited(
            edited(after, do="comment", node="root/0", text=""), do="delete", node="root/1"
        )

    def test_a_comment_that_would_be_read_as_that_of_another_node_is_refused(self):
        text = "pomona: 1\ntree: t\nroot: {sequence: [{Beep: {}}]}\n"
        with pytest.raises(EditError, match="that of another node"):
            edited(text, do="comment", node="root/0", text="loud")

    def test_parameters_are_declared_set_and_taken_away(self):
        first = edited(TREE, do="set_parameter", name="far", value="3 mm")
        assert changed(TREE, first)[1] == "parameters:\n  far: {type: length, default: 3 mm}\n\n"
        second = edited(first, do="set_parameter", name="far", value="4 mm")
        assert changed(first, second)[1] == "  far: {type: length, default: 4 mm}\n"
        whole = edited(second, do="set_parameter", name="n", value="{type: int, min: 1}")
        assert changed(second, whole)[1] == "  n: {type: int, min: 1}\n"
        assert edited(whole, do="set_parameter", name="n", value=None) == second

    def test_a_condition_is_set_as_a_port_of_its_word(self):
        text = HEAD + '  if: "{a} > 1"   # large\n  then: {Beep: {}}\n'
        after = edited(text, do="set_port", node="root/0", port="check", value='"{a} > 2"')
        assert after == text.replace("> 1", "> 2")


class TestLists:
    def test_a_list_without_nodes_is_written_as_brackets_and_filled_again(self):
        text = "pomona: 1\ntree: t\nroot:\n  sequence:   # all\n    - Beep: {}\n"
        empty = edited(text, do="delete", node="root/0")
        assert empty == "pomona: 1\ntree: t\nroot:\n  sequence: []   # all\n"
        assert edited(empty, do="insert", into="root", index=0, node="Beep: {}") == text

    def test_a_root_is_taken_out_and_put_in_again_before_the_subtrees(self):
        text = (
            "pomona: 1\ntree: t\nroot:\n  Beep: {}\n\nsubtrees:\n  s:\n    root:\n      Beep: {}\n"
        )
        without = edited(text, do="delete", node="root")
        assert "\nroot:" not in without
        again = edited(without, do="insert", into="", node="Beep: {}")
        assert again.startswith("pomona: 1\ntree: t\n\nroot:\n  Beep: {}\n\nsubtrees:")
        assert edited(
            edited(text, do="delete", node="s:root"), do="insert", into="s:", node="wait: 1 s"
        ) == (text.replace("      Beep", "      wait").replace("wait: {}", "wait: 1 s"))

    def test_a_node_goes_into_brackets_in_braces_unless_it_has_a_comment(self):
        text = "pomona: 1\ntree: t\nroot:\n  sequence: [Beep: {}, {wait: 1 s}]   # all\n"
        for node, written in (("succeed: {}", ""), ("succeed: {}\nretry: 2", ", retry: 2")):
            after = edited(text, do="insert", into="root", index=1, node=node)
            line = f"  sequence: [Beep: {{}}, {{succeed: {{}}{written}}}, {{wait: 1 s}}]   # all\n"
            assert changed(text, after)[1] == line
        for node in ("# two\nsucceed: {}", "wait: 1 s   # first"):
            with pytest.raises(EditError, match="it holds comments"):
                edited(text, do="insert", into="root", index=1, node=node)

    def test_nodes_are_put_below_words_and_cases(self):
        text = (
            HEAD
            + '  sequence:\n    - if: "true"\n      then: {Beep: {}}\n    - Beep: {}\n      retry: 2\n'
        )
        after = edited(text, do="insert", into="root/0", slot="else", node="fail: {}")
        assert changed(text, after)[1] == "      else:\n        fail: {}\n"
        after = edited(text, do="move", node="root/1", into="root/0", slot="else")
        assert changed(text, after)[1] == "      else:\n        Beep: {}\n        retry: 2\n"
        after = edited(text, do="insert", into="root/1", slot="on_failure", node="wait: 1 s")
        assert changed(text, after)[1] == "      on_failure:\n        wait: 1 s\n"
        switch = text.replace('if: "true"', 'switch: "{n}"').replace(
            "then: {Beep: {}}", "cases: {low: {Beep: {}}}"
        )
        after = edited(switch, do="insert", into="root/0", slot="high", node="fail: {}")
        assert changed(switch, after)[1] == "      cases: {low: {Beep: {}}, high: {fail: {}}}\n"
        with pytest.raises(EditError, match="name the case"):
            edited(edited(switch, do="insert", into="root/0", node="fail: {}"), do="insert", into="root/0",
                   node="fail: {}")  # fmt: skip


class TestRefused:
    @pytest.mark.parametrize(
        ("message", "said"),
        [
            ({}, "no edit is named None"),
            ({"do": "fly"}, "no edit is named 'fly'"),
            ({"do": "delete"}, "lacks node"),
            ({"do": "delete", "node": 3}, "is a text"),
            ({"do": "insert", "into": "root", "node": "Beep: {}", "index": True}, "is a number"),
            ({"do": "delete", "node": "root", "index": 2}, "has no 'index'"),
        ],
    )
    def test_a_malformed_message(self, message, said):
        with pytest.raises(EditError, match=said):
            edit_of(message)

    @pytest.mark.parametrize(
        ("message", "said"),
        [
            ({"do": "delete", "node": "root/7"}, "no node at root/7"),
            ({"do": "move", "node": "root/1", "into": "root/1/on_failure"}, "cannot move into itself"),
            ({"do": "move", "node": "root/0", "into": "root", "index": 2}, "no place among them"),
            ({"do": "insert", "into": "root/0", "node": "Beep: {}"}, "no place for another node"),
            ({"do": "insert", "into": "root", "node": "Beep"}, "a node is a mapping"),
            ({"do": "insert", "into": "root", "node": "a: [b"}, "no YAML"),
            ({"do": "insert", "into": "root", "node": "a: &x 1\nb: *x"}, "no YAML"),
            ({"do": "insert", "into": "", "node": "Beep: {}"}, "a root already"),
            ({"do": "wrap", "node": "root", "in": "Beep"}, "no word that takes a node"),
            ({"do": "wrap", "node": "root", "in": "switch"}, "by word"),
            ({"do": "duplicate", "node": "root"}, "only one node has its place"),
            ({"do": "unwrap", "node": "root"}, "only one node has its place"),
            ({"do": "set_port", "node": "root", "port": "x", "value": "1"}, "has no ports"),
            ({"do": "set_port", "node": "root/0", "port": "x", "value": "a: b: c"}, "no YAML"),
            ({"do": "set_modifier", "node": "root", "modifier": "success_on", "value": "1"}, "no modifier of sequence"),
        ],
    )  # fmt: skip
    def test_an_edit_that_means_nothing_is_refused_with_the_node(self, message, said):
        with pytest.raises(EditError, match=said):
            apply(TREE, edit_of(message))

    @pytest.mark.parametrize(
        "text",
        [
            "", "# nothing", "- a list", "root: [", "root: &a {Beep: {}}\nb: *a", "root:\n\t- Beep: {}",
            "pomona: 1\nroot: {Beep: {}}\nroot: {Beep: {}}\n", "<root/>", "a: 1\n---\nb: 2\n", "\x00",
        ],
    )  # fmt: skip
    def test_a_text_that_is_no_tree_is_left_alone(self, text):
        with pytest.raises(EditError):
            apply(text, TreeEdit("delete", node="root"))
        assert all(not node["id"] for node in nodes(text))

    @pytest.mark.parametrize(
        "said",
        [
            {"do": "set_modifier", "node": "root/0", "modifier": "timeout", "value": "3 s  # c"},
            {"do": "set_modifier", "node": "root/0", "modifier": "retry", "value": "3 # c"},
            {"do": "set_port", "node": "root/0", "port": "fruit", "value": "pear # c"},
            {"do": "set_port", "node": "root/1/0", "port": "wait", "value": "3 s # c"},
            {"do": "wrap", "node": "root/1/0", "in": "retry", "value": "3 # c"},
            {"do": "set_parameter", "name": "tries", "value": "3 # c"},
        ],
        ids=lambda said: f"{said['do']} {said.get('modifier', said.get('port', ''))}",
    )
    def test_a_comment_behind_a_value_on_one_line_is_refused_not_dropped(self, said):
        with pytest.raises(EditError, match="comment"):
            apply(TREE, edit_of(said))

    def test_a_tab_in_a_block_that_moves_is_refused(self):
        text = "pomona: 1\ntree: t\nroot:\n  sequence:\n    - Beep: {a: 1,\n\tb: 2}\n    - fallback:\n        - Beep: {}\n"
        with pytest.raises(EditError, match="tab"):
            edited(text, do="move", node="root/0", into="root/1", index=0)

    def test_a_comment_in_braces_is_never_lost(self):
        with pytest.raises(EditError, match="comment"):
            edited(ODD[1], do="delete", node="root/0")


class TestWhatIsLeft:
    """Edits that take a part away on which another part depends: the findings report what is left."""

    def test_a_modifier_goes_alone_and_the_words_that_depend_on_it_are_found(self):
        text = (
            HEAD
            + '  wait: 1 s\n  retry: 3\n  # when to go on\n  retry_if: "failure.code == NO_PATH"\n'
        )
        message = {"do": "set_modifier", "node": "root", "modifier": "retry", "value": None}
        after = edited(text, **message)
        assert changed(text, after) == ("  retry: 3\n", "")
        assert judge(text, message, after) == ""
        assert "'retry_if' means nothing without 'retry'" in [
            found.message for found in read(after, "t.yaml").findings
        ]

    @pytest.mark.parametrize("between", ["", "\n", "      \n", "      # of the sequence\n"])
    def test_a_subtree_whose_only_node_moves_away_loses_the_key_of_that_node(self, between):
        rest = f"subtrees:\n  look:\n    in: {{a: int}}\n    root:\n{between}      sequence:\n        - wait: 2 s\n"
        text = HEAD + "  sequence:\n    - wait: 1 s\n" + rest
        message = {"do": "move", "node": "look:root", "into": "root", "index": 1}
        after = edited(text, **message)
        assert judge(text, message, after) == ""
        assert after.count("root:") == 1
        assert after.endswith("subtrees:\n  look:\n    in: {a: int}\n")
        assert "    - sequence:\n        - wait: 2 s\n" in after


class TestRandomEdits:
    @pytest.mark.parametrize("seed", range(40))
    def test_only_touched_lines_differ_no_comment_is_lost_and_the_meaning_is_that_of_the_edit(
        self, seed
    ):
        rng = random.Random(seed)
        text = texts()[rng.choice(sorted(texts()))] if seed % 4 else ODD[seed // 4 % len(ODD)]
        text = disturbed(rng, text) if rng.random() < 0.5 else text
        made = 0
        for _ in range(40):
            message = random_edit(rng, text)
            after, _ = refused(text, message)
            if after is None:
                continue
            assert judge(text, message, after) == "", (message, text, after)
            assert apply(text, edit_of(message)) == after
            made += 1
            if made == 8 or not nodes(after) or not nodes(after)[0]["id"]:
                return
            text = after

    def test_line_ends_and_a_byte_order_mark_stay(self):
        windows = "\ufeff" + TREE.replace("\n", "\r\n")
        for message in (
            {"do": "move", "node": "root/0", "into": "root/1", "index": 1},
            {"do": "wrap", "node": "root/1", "in": "sequence"},
            {
                "do": "insert",
                "into": "root",
                "index": 2,
                "node": "description: |\n  a\n  b\nBeep: {}",
            },
            {"do": "set_parameter", "name": "n", "value": "3"},
        ):
            assert apply(windows, edit_of(message)) == "\ufeff" + apply(
                TREE, edit_of(message)
            ).replace("\n", "\r\n")
            assert apply(TREE[:-1], edit_of(message)) == apply(TREE, edit_of(message))[:-1]


def test_nodes_are_listed_with_their_places():
    found = {node["id"]: node for node in nodes(ODD[0])}
    assert list(found)[:6] == ["root", "root/0", "root/1", "root/1/0", "root/1/1", "root/1/2"]
    detect = found["root/0"]
    assert (detect["type"], detect["kind"], detect["line"], detect["end_line"]) == (
        "Detect",
        "skill",
        8,
        11,
    )
    assert detect["ports"][1] == {"name": "detection", "text": '"{found}"', "line": 11}
    assert [m["name"] for m in detect["modifiers"]] == ["retry"]
    assert (found["root/1/0"]["type"], found["root/1/0"]["slot"]) == ("check", "if")
    assert found["root/3/0"]["slot"] == "low"
    assert found["last:root/on_failure"]["comment"] == "before the wait"
    assert found["look:root"]["tree"] == "look"


def test_a_node_that_cannot_be_read_is_listed_with_the_error():
    text = "pomona: 1\ntree: t\nroot:\n  sequence:\n    - 3\n    - Beep: {}\n    - retry: 2\n"
    assert [(n["id"], bool(n["error"])) for n in nodes(text)] == [
        ("root", False),
        ("root/0", True),
        ("root/1", False),
        ("root/2", True),
    ]
    assert edited(text, do="delete", node="root/0") == text.replace("    - 3\n", "")
