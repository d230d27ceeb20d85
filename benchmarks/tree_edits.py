"""Random edits of tree files, and a judge of each, written apart from the editor, on lines and on the tree as read.

The judge wants of each edit that untouched lines are there byte for byte in their order, that no comment is lost which
does not belong to something that is taken out, that the new text reads as the tree with the edit made, and that taking
an inserted node out again gives the bytes before.
"""

from __future__ import annotations

import ast
import copy
import random
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pomona.executive.language.model import Document, TreeNode
from pomona.executive.language.read import read
from pomona.executive.values.findings import Finding, TreeFileError
from pomona.executive.values.yaml_nodes import written
from pomona.tools.editor.edits import EditError, TreeEdit, apply, edit_of, nodes

ROOT = Path(__file__).resolve().parents[1]

NODES = (
    "Beep: {}", "Beep:", "Detect: {fruit: apple, detection: \"{found}\"}", "wait: 2 s   # a moment",
    "check: \"{found.score} > 0.8\"\nwhen: \"failure.code == NO_PATH\"", "{Beep: {}, retry: 3}",
    "# above\nsequence:\n  - Beep: {}   # inside\n  # before the second\n  - wait: 1 s\nname: Pasted {n}",
    "description: |\n  two\n    lines\nsucceed: {}", "fallback: [{Beep: {}}, {wait: 1 s}]",
    "fail: {code: NO, message: \"a: b, c\"}",
)  # fmt: skip
VALUES = (
    "3",
    "2 s",
    '"{found}"',
    "apple",
    "a, b",
    '"quoted # no comment"',
    "[1, 2]",
    "{position: [0, 0, 1]}",
    "'it''s'",
)
WORDS = (
    "sequence",
    "fallback",
    "parallel",
    "reactive_sequence",
    "retry",
    "timeout",
    "repeat",
    "invert",
    "when",
    "if",
)
BESIDE = ("retry", "timeout", "when", "guard", "description", "repeat", "delay")


ODD = (
    """\
# the head
pomona: 1
tree: odd   # its name

root:   # the key's comment
  # above the root
  sequence:   # beside it
  - retry: 3   # first a modifier
    # then the type
    Detect: {fruit: apple,   # the fruit
             detection: "{found}"}

  # before the if
  -
    # below the dash
    if: "{found.score} > 0.5"
    then:
        wait: 1 s
        # at the end of then
    else: {fail: {}}   # beside else
  -   name: Long
      description: >
        two
        lines

      fallback: [Beep: {}, {wait: 2 s}, {check: "{found.score} > 0.1", when: "failure.code == NO"}]
  - switch: "{found.score}"
    cases:
      # of low
      low: {Beep: {}}
      high:   # of high
        wait: 1 s
    default:
      succeed:
  # after all of them

      # far right
  name: Odd

# before the subtrees
subtrees:
  look:   # looks
    in: {a: int}
    root: {sequence: [{Beep: {}}, {wait: "{a} * 1 s"}], retry: 2}

  # the last
  last:
    root:
      Beep:
        volume: 3   # loud

        # before the text
        said: |
          # no comment
            deep

          end
      retry: 2
      on_failure:
        # before the wait
        wait: 2 s
""",
    """\
pomona: 1
tree: braces
parameters: {n: {type: int, default: 3}}
root: {sequence: [
  {Beep: {}, name: One},   # one
  {fallback: [{wait: 1 s}, {Beep: {volume: 1,
                                   said: "two
    lines"}}], retry: 2},
  Beep: {},
], name: Braces}
subtrees: {inner: {root: {Beep: }}, other: {root: {parallel: []}}}
""",
    """\
pomona: 1
tree: "quoted"
parameters:
    n: int
    # of m
    m:
        type: length
        default: 3 mm
root:
    "parallel":

        -   Beep: {}

        # between

        -   'wait': 1 s
            "name": 'It''s'
            timeout:   2 s
    success_on:
        - Beep
""",
)


# ----------------------------------------------------------------------------------------------------- texts


def tree_texts(seed: int = 0) -> dict[str, str]:
    """Return texts of trees: shipped, in documents, in tests, and variants of them."""
    found = {
        str(path.relative_to(ROOT)): path.read_text("utf-8")
        for path in _files()
        if _is_tree(path.read_text("utf-8"))
    }
    for path in [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md"]:
        for number, block in enumerate(
            re.findall(r"```yaml\n(.*?)```", path.read_text("utf-8"), re.DOTALL)
        ):
            found[f"{path.name} {number}"] = block
    for path in sorted((ROOT / "tests" / "executive").rglob("test_*.py")):
        for number, value in enumerate(_literals(path)):
            found[f"{path.name} {number}"] = value
    found = {name: text for name, text in found.items() if _is_tree(text)}
    found |= {f"odd {number}": text for number, text in enumerate(ODD)}
    rng = random.Random(seed)
    for name in rng.sample(sorted(found), min(30, len(found))):
        text = found[name].rstrip("\n")
        found[f"{name} CRLF"] = "\ufeff" + text.replace("\r\n", "\n").replace("\n", "\r\n") + "\r\n"
        found[f"{name} cut"] = text
    return found


def disturbed(rng: random.Random, text: str) -> str:
    """Return a text with comments, blank lines and blanks in places where they change nothing; or the text itself."""
    lines = text.split("\n")
    for _ in range(rng.randint(1, 12)):
        row = rng.randrange(len(lines))
        near = len(lines[row]) - len(lines[row].lstrip(" "))
        note = f"# note {rng.randrange(1000)}"
        if rng.random() < 0.6:
            lines.insert(row, " " * rng.choice((near, near, near + 2, max(0, near - 2), 0)) + note)
        elif rng.random() < 0.5:
            lines.insert(row, rng.choice(("", "", " " * near)))
        elif lines[row].strip() and "#" not in lines[row] and not lines[row].endswith("\r"):
            lines[row] += rng.choice((f"  {note}", "  "))
    found = "\n".join(lines)
    return found if _content(found) == _content(text) else text


def _content(text: str) -> list[object]:
    """Return the nodes of a text without their lines and comments."""
    apart = {"line", "end_line", "comment", "ports", "modifiers"}
    return [
        (
            {k: v for k, v in node.items() if k not in apart},
            [(e["name"], e["text"]) for e in _entries(node)],
        )
        for node in nodes(text)
    ]


def _entries(node: dict[str, Any]) -> list[dict[str, Any]]:
    return [*node.get("ports", ()), *node.get("modifiers", ())]


def _files() -> Iterator[Path]:
    for folder in ("trees", "executive/trees", "examples", "benchmarks"):
        yield from sorted((ROOT / folder).rglob("*.yaml"))


def _literals(path: Path) -> Iterator[str]:
    text = path.read_text("utf-8")
    for node in ast.walk(ast.parse(text)) if "root:" in text else ():
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and "\nroot:" in node.value
        ):
            yield node.value


def _is_tree(text: str) -> bool:
    return (
        "root:" in text and len(text) < 60_000 and bool(nodes(text)) and bool(nodes(text)[0]["id"])
    )


# ----------------------------------------------------------------------------------------------------- edits


def random_edit(rng: random.Random, text: str) -> dict[str, Any]:
    """Return the message of a random edit that names nodes of a text."""
    table = nodes(text)
    kind = rng.choice(
        ("insert", "insert", "move", "move", "move", "wrap", "wrap", "unwrap", "delete", "duplicate", "rename",
         "set_port", "set_port", "set_modifier", "set_modifier", "comment", "set_parameter")
    )  # fmt: skip
    node = rng.choice(table)
    if not node["parent"] and rng.random() < 0.7:
        node = rng.choice(table)
    if kind in ("unwrap", "duplicate"):
        node = rng.choice(
            [n for n in table if n["kind"] == "composite" or kind == "duplicate"] or table
        )
    address = node["id"]
    parents = [n for n in table if n["kind"] == "composite"] or table
    if kind == "insert":
        into = rng.choice(parents)
        text = rng.choice(NODES).replace("{n}", str(rng.randrange(10**6)))
        return {"do": kind, **_into(rng, into, table), "node": text}
    if kind == "move":
        into = rng.choice(
            [n for n in parents if not f"{n['id']}/".startswith(f"{address}/")] or parents
        )
        return {"do": kind, "node": address, **_into(rng, into, table, address)}
    if kind == "wrap":
        return {"do": kind, "node": address, "in": rng.choice(WORDS)}
    if kind == "rename":
        return {
            "do": kind,
            "node": address,
            "name": rng.choice(("", "Go", "Go: on", "Größe", "a # b", "null", "3")),
        }
    if kind == "set_port":
        leaf = rng.choice(
            [n for n in table if n["ports"] or n["kind"] in ("skill", "subtree")] or table
        )
        port = rng.choice([p["name"] for p in leaf["ports"]] + ["new_port"])
        return {"do": kind, "node": leaf["id"], "port": port, "value": rng.choice((None, *VALUES))}
    if kind == "set_modifier":
        word = rng.choice(
            [m["name"] for m in node["modifiers"] if m["name"] != "on_failure"]
            + [rng.choice(BESIDE)]
        )
        return {"do": kind, "node": address, "modifier": word, "value": rng.choice((None, *VALUES))}
    if kind == "comment":
        said = rng.choice(("", "one line", "one: line # with more", "two\nlines"))
        return {"do": kind, "node": address, "text": said}
    if kind == "set_parameter":
        names = re.findall(
            r"^  (\w+):", text.partition("parameters:")[2].partition("\nroot:")[0], re.MULTILINE
        )
        value = rng.choice((None, "3", "2 s", "apple", "{type: text, default: a}"))
        return {"do": kind, "name": rng.choice([*names, "fresh"]), "value": value}
    return {"do": kind, "node": address}


def _into(
    rng: random.Random, into: dict[str, Any], table: list[dict[str, Any]], leaving: str = ""
) -> dict[str, Any]:
    count = sum(n["parent"] == into["id"] and n["index"] >= 0 and n["id"] != leaving for n in table)
    place: dict[str, Any] = {"into": into["id"], "index": rng.randint(0, count)}
    words = {"if": ("else",), "switch": ("more", "default")}.get(into["type"], ())
    if words and rng.random() < 0.9:
        place["slot"] = rng.choice(words)
    elif rng.random() < 0.1 and any(m["name"] == "retry" for m in into["modifiers"]):
        place["slot"] = "on_failure"
    return place


# ----------------------------------------------------------------------------------------------------- judge

Shape = dict[str, Any]
_REPAIRED = ("unknown-key", "two-types", "unknown-type-of-node", "no-type")
_KEY = re.compile(r"\s*[\w\"']+\s*:\s*(#.*)?$")
_ABOVE = re.compile(r"\s*(#|-\s*(#|$)|[^#]*[\w\"']\s*:\s*(#|$|\[|\{))")


def judge(before: str, message: dict[str, Any], after: str) -> str:
    """Return the fault of an edit; empty when it has none."""
    edit = edit_of(message)
    if edit.do == "move" and after == before and edit.node.rpartition("/")[0] == edit.into:
        return ""  # it stands there already
    table = nodes(after)
    if table and not table[0]["id"]:
        return f"it cannot be read: {table[0]['error']}"
    return (
        _lines(before, edit, after)
        or _comments(before, edit, after)
        or _meaning(before, edit, after)
        or (_undone(before, edit, after) if edit.do == "insert" else "")
    )


def _rows_of(text: str, address: str) -> set[int]:
    """Return the rows of a node: its lines, its comments, the keys directly above it."""
    lines = text.split("\n")
    node = next((n for n in nodes(text) if n["id"] == address), None)
    if node is None:
        return set()
    first, last = node["line"] - 1, node["end_line"] - 1
    while first > 0:
        above = first - 1
        while above > 0 and not lines[above].strip():
            above -= 1  # blank lines between a key and its node
        if not (_ABOVE if above == first - 1 else _KEY).match(lines[above]):
            break
        first = above
    while last + 1 < len(lines) and lines[last + 1].lstrip().startswith("#"):
        last += 1
    return set(range(first, last + 1))


def _rows_of_root(lines: list[str]) -> set[int]:
    """Rows of the whole tree, with `root:` and the notes right above it."""
    first = last = next(
        (row for row, line in enumerate(lines) if re.match(r"\ufeff?[\"']?root[\"']?\s*:", line)), 0
    )
    while first > 0 and lines[first - 1].startswith("#"):
        first -= 1
    while last + 1 < len(lines) and not re.match(r"[A-Za-z_]", lines[last + 1]):
        last += 1
    return set(range(first, last + 1))


def _lines(before: str, edit: TreeEdit, after: str) -> str:
    """Untouched lines are in the new text byte for byte, in their order."""
    lines = before.split("\n")
    if edit.do == "set_parameter":
        touched = {
            row
            for row, line in enumerate(lines)
            if re.match(rf"\ufeff?\s*({edit.name}|parameters)\b", line)
        }
        touched |= {
            row for row, line in enumerate(lines) if "{" in line and f"{edit.name}:" in line
        }
        touched |= {
            row + 1 for row in touched if row + 1 < len(lines) and not lines[row + 1].strip()
        }
        touched |= (
            _below(lines, edit.name) if edit.value is None else set()
        )  # with the notes right above it
        touched |= {row for row, line in enumerate(lines) if line.startswith("    ")} & _below(
            lines, edit.name
        )
    else:
        touched = _rows_of(before, edit.into if edit.do == "insert" else edit.node)
        if edit.do == "insert":
            key = next(n["line"] for n in nodes(before) if n["id"] == edit.into) - 1
            flow = any(mark in lines[row] for row in touched for mark in ("[", "{"))
            touched = touched if flow else {key}
        parent = edit.node.rpartition("/")[0]
        if edit.do == "delete" and not parent:
            touched |= _rows_of_root(lines)
        if edit.do in ("delete", "move") and sum(n["parent"] == parent for n in nodes(before)) == 1:
            touched.add(
                next((n["line"] - 1 for n in nodes(before) if n["id"] == parent), 0)
            )  # it has `[]` now
        if edit.do == "move":
            touched |= {
                row for row in _rows_of(before, edit.into) if re.search(r"[\[\]{}]", lines[row])
            }
            touched |= {
                row
                for row in _rows_of(before, edit.into)
                if re.search(r":\s*(#.*)?\r?$", lines[row])
            }
    if lines[-1] and len(lines) - 1 not in touched and not after.endswith(lines[-1]):
        lines[-1] += "\r" if "\r\n" in before else ""  # a line was put behind the last one
    rest = after.split("\n")
    left = iter(rest)
    for row, line in enumerate(lines):
        ends = (line, line.removesuffix("\r"))  # of a line that is the last one now
        if (
            row not in touched
            and line.strip()
            and not any(other == line or (other is rest[-1] and other in ends) for other in left)
        ):
            return f"line {row + 1} is lost or moved: {line!r}"
    return ""


def _below(lines: list[str], name: str) -> set[int]:
    found: set[int] = set()
    for row, line in enumerate(lines):
        if line.startswith(f"  {name}:"):
            first, last = row, row + 1
            while lines[first - 1].lstrip().startswith("#"):
                first -= 1
            while last < len(lines) and (lines[last].startswith("    ") or not lines[last].strip()):
                last += 1
            found |= set(range(first, last))
    return found


def _notes(text: str, rows: set[int] | None = None) -> Counter[str]:
    document = read(text.removeprefix("\ufeff"), "tree.yaml")
    found = document.main.source.comments
    return Counter(note for line, note in found.items() if rows is None or line - 1 in rows)


def _comments(before: str, edit: TreeEdit, after: str) -> str:
    lost = _notes(before) - _notes(after)
    takes_a_word = (edit.do == "set_modifier" and edit.value is None) or (
        edit.do == "rename" and not edit.name
    )
    if edit.do in ("delete", "comment") or takes_a_word:
        whole = edit.do == "delete" and edit.node == "root"
        lost -= _notes(
            before, _rows_of_root(before.split("\n")) if whole else _rows_of(before, edit.node)
        )
    if edit.do in ("set_modifier", "set_port", "set_parameter") and lost:
        gone = [line for line in before.split("\n") if line not in after.split("\n")]
        lost = Counter(
            {note: count for note, count in lost.items() if not any(note in line for line in gone)}
        )
    return f"lost comments: {list(lost)}" if lost else ""


# ----------------------------------------------------------------------------------------------------- meaning


def _shape(node: TreeNode, lead: str = "") -> Shape:
    parts = {slot: _shape(part) for slot, part in node.parts.items()}
    value = {port: written(value) for port, (_, value) in node.ports.items()}
    single = "" if node.type.value.nodes or node.type.value.wires else written(node.value)
    if node.type.key == "switch":
        single = written(node.value)
    beside = {
        w: written(v)
        for w, (_, v) in node.modifiers.items()
        if w not in parts and not _holds_nodes(node, w)
    }
    kids = [
        _shape(child, lead.removesuffix(": "))
        for child, lead in zip(node.children, node.leads, strict=True)
    ]
    return {
        "type": node.key.text, "lead": lead, "name": node.name.text if node.name is not None else "", "ports": value,
        "value": single, "beside": beside, "description": node.description, "kids": kids, "parts": parts,
    }  # fmt: skip


def _holds_nodes(node: TreeNode, word: str) -> bool:
    return word in node.type.fields and node.type.fields[word].nodes


def _shapes(document: Document) -> dict[str, Shape]:
    """Return the trees of a file by the beginning of their addresses."""
    found: dict[str, Shape] = {}
    for definition in document.definitions():
        if definition.file is document.main and definition.root is not None:
            found["" if definition.main else f"{definition.name}:"] = _shape(definition.root)
    return found


def _read(text: str) -> Document:
    return read(text.removeprefix("\ufeff"), "tree.yaml")


def _guessed(finding: Finding) -> bool:
    """Return whether the reader guesses: it leaves out a `retry_if` whose `retry` was taken away, for example."""
    return finding.code in _REPAIRED or "means nothing without" in finding.message


def _meaning(before: str, edit: TreeEdit, after: str) -> str:
    """The new text reads as the tree before with the edit made."""
    old, new = _read(before), _read(after)
    if any(node["error"] for node in nodes(before)) or any(
        map(_guessed, (*old.findings, *new.findings))
    ):
        return ""  # the reader guesses a meaning
    if edit.do == "set_parameter":
        declared = new.main.parameters.get(edit.name)
        if edit.value is None:
            return "" if declared is None else "the parameter is still there"
        wanted = "a" if edit.value.startswith("{") else edit.value
        found = (
            written(declared.default)
            if declared is not None and declared.default is not None
            else None
        )
        return "" if found == wanted else f"the parameter is {found!r}"
    if edit.do == "comment":
        found = next(node["comment"] for node in nodes(after) if node["id"] == edit.node)
        return "" if found == " ".join(edit.text.split()) else f"the comment is {found!r}"
    if edit.word == "description" and (edit.value or "")[:1] in ("[", "{"):
        return ""  # it is no text
    shapes = _shapes(old)
    _change(shapes, edit)
    if edit.do == "duplicate":
        return _same_but_names(shapes, _shapes(new))
    reads = _shapes(new)
    return "" if reads == shapes else f"it reads as {reads}, expected {shapes}"


def _same_but_names(wanted: dict[str, Shape], found: dict[str, Shape]) -> str:
    def nameless(shape: Shape) -> Shape:
        inner = {
            "kids": [nameless(k) for k in shape["kids"]],
            "parts": {w: nameless(p) for w, p in shape["parts"].items()},
        }
        return {**shape, "name": bool(shape["name"]), **inner}

    same = {t: nameless(s) for t, s in wanted.items()} == {t: nameless(s) for t, s in found.items()}
    return "" if same else "the copy differs"


def _at(shapes: dict[str, Shape], address: str) -> tuple[Shape, str]:
    """Return the node around an address, as one with `kids` or `parts`, and the last step."""
    prefix, _, steps = address.partition("root")
    *around, last = steps.split("/") if steps else [""]
    node: Shape = {"kids": [shapes[prefix]], "parts": {}} if not steps else shapes[prefix]
    for step in around[1:]:
        node = node["kids"][int(step)] if step.isdecimal() else node["parts"][step]
    return node, last or "0"


def _get(shapes: dict[str, Shape], address: str) -> Shape:
    node, last = _at(shapes, address)
    found: Shape = node["kids"][int(last)] if last.isdecimal() else node["parts"][last]
    return found


def _set(shapes: dict[str, Shape], address: str, shape: Shape) -> None:
    node, last = _at(shapes, address)
    old = _get(shapes, address)
    shape["lead"] = old["lead"]
    if "root" in address and address.endswith("root"):
        shapes[address.removesuffix("root")] = shape
    elif last.isdecimal():
        node["kids"][int(last)] = shape
    else:
        node["parts"][last] = shape


def _new(word: str, **fields: Any) -> Shape:
    empty = {
        "lead": "",
        "name": "",
        "ports": {},
        "value": "",
        "beside": {},
        "description": "",
        "kids": [],
        "parts": {},
    }
    return {"type": word, **empty, **fields}


def _from_yaml(text: str) -> Shape:
    inside = "\n".join("  " + line for line in text.split("\n"))
    document = _read(f"pomona: 1\ntree: t\nroot:\n{inside}\n")
    assert document.main.main is not None
    assert document.main.main.root is not None
    return _shape(document.main.main.root)


def _value(text: str) -> str:
    shape = _from_yaml(
        f"Beep: {{}}\ndescription: {text}" if text[:1] not in "[{" else f"Beep: {{p: {text}}}"
    )
    return str(shape["description"] or shape["ports"]["p"])


def _change(shapes: dict[str, Shape], edit: TreeEdit) -> None:
    """Make an edit on the trees."""
    if edit.do == "insert":
        _insert(shapes, edit, _get(shapes, edit.into), _from_yaml(edit.node))
        return
    node, kind = _get(shapes, edit.node), edit.do
    around, last = _at(shapes, edit.node)
    if kind == "move":
        into = _get(shapes, edit.into)
        _remove(shapes, edit.node)
        _insert(shapes, edit, into, node)
    elif kind == "delete":
        _remove(shapes, edit.node)
    elif kind == "duplicate":
        around["kids"].insert(int(last), copy.deepcopy(node))
    elif kind == "unwrap":
        inner = node["kids"]
        if len(inner) == 1:
            _set(shapes, edit.node, inner[0])
        else:
            for kid in inner:
                kid["lead"] = ""
            around["kids"][int(last) : int(last) + 1] = inner
    elif kind == "wrap":
        _wrap(shapes, edit, node)
    elif kind == "rename":
        node["name"] = edit.name
    elif kind == "set_modifier":
        field = "description" if edit.word == "description" else "beside"
        if field == "description":
            node[field] = _value(edit.value) if edit.value is not None else ""
        elif edit.value is None:
            node[field].pop(edit.word, None)
        else:
            node[field][edit.word] = _value(edit.value)
    elif kind == "set_port" and edit.word == node["type"]:
        node["value"] = _value(edit.value or "")
    elif kind == "set_port":
        if edit.value is None:
            node["ports"].pop(edit.word, None)
        else:
            node["ports"][edit.word] = _value(edit.value)


def _insert(shapes: dict[str, Shape], edit: TreeEdit, into: Shape, node: Shape) -> None:
    node["lead"] = edit.slot if edit.slot != "on_failure" else ""
    if edit.slot == "on_failure":
        into["parts"]["on_failure"] = node
    elif edit.slot == "else" or edit.slot == "default":
        into["kids"].append(node)
    elif edit.slot:
        has_default = any(kid["lead"] == "default" for kid in into["kids"])
        into["kids"].insert(len(into["kids"]) - has_default, node)
    elif into["type"] in ("if", "reactive_if"):
        leads = [kid["lead"] for kid in into["kids"]]
        node["lead"] = "then" if "then" not in leads else "else"
        into["kids"].insert(1 if node["lead"] == "then" else 2, node)
    elif into["type"] == "switch":
        node["lead"] = "default"
        into["kids"].append(node)
    else:
        into["kids"].insert(edit.index, node)


def _remove(shapes: dict[str, Shape], address: str) -> None:
    around, last = _at(shapes, address)
    if address.endswith("root"):
        del shapes[address.removesuffix("root")]
    elif last.isdecimal():
        del around["kids"][int(last)]
    else:
        del around["parts"][last]


def _wrap(shapes: dict[str, Shape], edit: TreeEdit, node: Shape) -> None:
    defaults = {"retry": "3", "timeout": "5 s", "repeat": "3", "invert": "true", "when": "true"}
    value = defaults.get(edit.word)
    if value is not None and edit.word not in node["beside"]:
        node["beside"][edit.word] = value
        return
    inner = {**node, "lead": ""}
    if value is not None:
        _set(shapes, edit.node, _new("sequence", kids=[inner], beside={edit.word: value}))
    elif edit.word == "if":
        asked = _new("check", value="true", lead="if")
        _set(shapes, edit.node, _new("if", kids=[asked, {**inner, "lead": "then"}]))
    else:
        _set(shapes, edit.node, _new(edit.word, kids=[inner]))


def _undone(before: str, edit: TreeEdit, after: str) -> str:
    """A node that was put in and is taken out again leaves the bytes before."""
    new = [node for node in nodes(after) if node["parent"] == edit.into]
    parent = next(node for node in nodes(before) if node["id"] == edit.into)
    if edit.slot:
        address = next(node["id"] for node in new if node["slot"] == edit.slot)
    elif parent["type"] in ("if", "reactive_if", "switch"):
        filled = {node["slot"] for node in nodes(before) if node["parent"] == edit.into}
        address = next((node["id"] for node in new if node["slot"] not in filled), "")
    else:
        address = f"{edit.into}/{edit.index}"
    try:
        again = apply(after, TreeEdit("delete", node=address))
    except EditError as error:
        return f"{address} cannot be taken out again: {error}"
    if again == before:
        return ""
    if not parent_holds_list(before, parent):
        return ""
    flow = re.search(
        rf"\b{parent['type']}:[ \t]*(\[|#|$|\n|\r)",
        "\n".join(before.split("\n")[parent["line"] - 1 : parent["end_line"]]),
    )
    if flow is not None and flow[1] == "[" and ("\n" in edit.node or "#" in edit.node):
        return ""  # a list in brackets is written with dashes now
    return f"taken out again, it leaves {again!r}"


def parent_holds_list(text: str, parent: dict[str, Any]) -> bool:
    """Return False for `sequence:` without a list, which is an error: the list that is taken out leaves `[]`."""
    count = sum(node["parent"] == parent["id"] for node in nodes(text))
    return count > 0 or "[]" in text.split("\n")[parent["line"] - 1]


def refused(text: str, message: dict[str, Any]) -> tuple[str | None, str]:
    """Return the new text, or None with the reason why the edit was refused."""
    try:
        return apply(text, edit_of(message)), ""
    except (EditError, TreeFileError) as error:
        return None, str(error)
