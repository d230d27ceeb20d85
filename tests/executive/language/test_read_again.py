"""What is read again of a changed text gives what reading all of it gives; and it is little."""

from __future__ import annotations

import dataclasses
import importlib.util
import random
from pathlib import Path
from typing import Any

import pytest

from pomona.executive.language import read
from pomona.executive.language.check import Analysis, analyse
from pomona.executive.language.declared_skills import declared_skills
from pomona.executive.language.model import Document
from pomona.executive.language.scope import Resolved
from pomona.executive.nodes.node_type import NodeType, TreeNode
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Located, Source, Spot, Within

SPEC = importlib.util.spec_from_file_location("fuzz", Path(__file__).with_name("fuzz.py"))
fuzzer = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(fuzzer)

SKILLS = Registry({**declared_skills(), **fuzzer.dummy_skills()})

ODD = """\
# what it is for
pomona: 1
tree: odd
root:
  sequence:
  # a list as far left as its key

  - fallback:
      - if: "{a} > 1"  # with a comment
        then: {MoveTo: {pose: "a # b"}}
        else: [x,
          y]
      # two lines
      # above
      - ask: |
          Is it?
            # no comment

        choices: [yes, no]
      - {sequence: [{MoveTo: {pose: home}}, {Beep: {}}], retry: 3}

      - switch: "{a}"
        cases:
          one: {fail: {code: ONE}}  # one
          # two
          two:
            sequence:
              - MoveTo:
                  pose: home
              -   Beep: {times: 2}
                  description: "in
                    two lines"
              - - MoveTo: {}
                - Beep: {}
              - Beep:
    on_failure:
      sequence:
        - Beep: {}   # last
        - retry: 2
          Beep: {}
          Beep: {}
  # nobody's
  - check: '{a} == 1'
  - look: {far: 2, seen: "{a}"}
  - sequence:
    - look: {}
      retry: 2
    - Beep: {times: "{a}"}
subtrees:
  look:
    in: {far: int}
    out: {seen: int}
    root:
      fallback:
      - set: {seen: "{far} + 1"}
      - Beep: {times: 1}
      - unknown: 3
        Beep: {}
      - check: "{x} > 2
          and {y} < 3"
"""
TYPED = (
    "\n", "\n      retry: 3", "\n    - Beep: {}\n", "\n  - sequence:\n    - Beep: {times: 2}\n", "  # why\n",
    '"', "'", "{", "[", "|\n", "- ", ": ", "  ", "\n\n", ">+\n", "timeout: 3 s\n", "\r\n", "\u2028", "\x0c", "\t",
    "--- ", "!x ", "!", "&a ", "*a", "? ",
)  # fmt: skip


def as_read(value: Any, seen: dict[int, Any] | None = None) -> Any:
    """Everything that a document holds, as plain values with every place."""
    seen = {} if seen is None else seen
    if isinstance(value, NodeType):
        return value.key
    if isinstance(value, Source):
        return value.path, value.text, tuple(sorted(value.comments.items())), tuple(sorted(value.comment_lines))
    if isinstance(value, dict):
        return {key: as_read(inner, seen) for key, inner in value.items()}
    if isinstance(value, list | tuple) and not isinstance(value, Within | Spot):
        return [as_read(inner, seen) for inner in value]
    if isinstance(value, Within | Spot):
        return as_place(value)
    if isinstance(value, type) or not dataclasses.is_dataclass(value):
        return value
    if id(value) not in seen:
        seen[id(value)] = type(value).__name__
        parts = {f.name: as_read(getattr(value, f.name), seen) for f in dataclasses.fields(value) if f.name != "types"}
        seen[id(value)] = (type(value).__name__, parts)
    return seen[id(value)]


def edited(text: str, base: str, trees: list[str], rng: random.Random) -> str:
    """A text after a few keys were pressed."""
    kind = rng.randrange(11)
    if kind >= 8 or not text:
        return base
    if kind == 0:
        return fuzzer.mutate(text, trees, rng)
    at = rng.randrange(len(text))
    if kind == 2:
        at = text.find("\n", at)  # the end of a line, where most is typed
        return text if at < 0 else text[:at] + rng.choice(TYPED) + text[at:]
    if kind == 3:
        return text[:at] + text[at + rng.choice((1, 1, 2, 8)) :]
    if kind == 4:
        return text[:at] + rng.choice(TYPED) + text[at:]
    lines = text.split("\n")
    row = rng.randrange(len(lines))
    if kind == 5:
        del lines[row : row + rng.choice((1, 1, 3))]
    elif kind == 6:
        lines.insert(row, rng.choice((*lines, "", "# x", "      # x")))
    else:
        lines[row] = " " * rng.randrange(9) + lines[row].lstrip()
    return "\n".join(lines)


def nodes(document: Document) -> list[TreeNode]:
    return [node for d in document.definitions() if d.root is not None for node in d.root.walk()]


def as_checked(analysis: Analysis) -> Any:
    """Everything that a check has looked up, in the order of the nodes."""
    found: list[Any] = [analysis.findings, analysis.parameters, analysis.finite]
    for definition in analysis.document.definitions():
        scope = analysis.scopes[id(definition)]
        found += [list(scope.names), as_read(scope.names)]
        for node in definition.root.walk() if definition.root is not None else ():
            found.append(scope.around.get(id(node)))
            found += [analysis.outcomes.layer(node, index) for index in range(len(node.layers))]
            for layer in node.layers:
                parts = analysis.resolved.get((id(node), layer.key), Resolved(node))
                found.append([as_read(getattr(parts, name)) for name in ("skill", "inputs", "outputs", "settings")])
                found.append([(*read[:2], *as_place(read.where), read.required) for read in parts.reads])
                found.append(parts.subtree is not None and parts.subtree.name)
    return found


def as_place(at: Located) -> tuple[str, int, int, int]:
    return at.source.text, at.line, at.column, at.length


def attempt(seed: str, edits: int, base: str, trees: list[str]) -> int:
    """Edit a text so often; how many nodes were taken over."""
    rng, text, taken = random.Random(seed), base, 0
    known = read(text, "t.yaml")
    checked = analyse(known, SKILLS)
    for _ in range(edits):
        text = edited(text, base, trees, rng)[:20_000]
        older = {id(node): node for node in nodes(known)}
        again = read(text, "t.yaml", before=known)
        whole = read(text, "t.yaml")
        assert as_read(again) == as_read(whole), (seed, text)
        analysis = analyse(again, SKILLS, before=checked)
        assert as_checked(analysis) == as_checked(analyse(whole, SKILLS)), (seed, text)
        taken += sum(id(node) in older for node in nodes(again))
        known = again if again.main.top is not None else known
        checked = analysis if nodes(again) else checked
    return taken


@pytest.mark.parametrize("number", range(len([ODD, *fuzzer.installed_trees()])))
def test_a_changed_text_is_read_as_the_whole_text_is(number):
    trees = [ODD, *fuzzer.installed_trees()]
    assert attempt(f"edits/{number}", 10, trees[number], trees) > 0
