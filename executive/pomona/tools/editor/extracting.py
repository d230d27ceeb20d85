"""A node made a subtree of its own: which names it reads and writes, and the text that declares them."""

from __future__ import annotations

import re
from pathlib import Path

from pomona.executive.language.check import Analysis, analyse
from pomona.executive.language.model import Definition
from pomona.executive.language.read import read
from pomona.executive.language.read_node import is_word
from pomona.executive.nodes.takes import NAME
from pomona.executive.registry import Registry
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.yaml_nodes import YamlMapping
from pomona.tools.editor.format import STEP
from pomona.tools.editor.patching import LiftedNode, TextPatch
from pomona.tools.editor.wrapping import on_its_lines
from pomona.tools.editor.written_tree import EditError, WrittenNode


def extract(
    patch: TextPatch, node: WrittenNode, name: str, skills: Registry | None, path: Path
) -> tuple[str, str]:
    """Make a node's type a subtree that the node calls; its modifiers stay where they are.

    Returns the call and the subtree's interface, as YAML. Raises EditError: the name cannot be used, or the wiring is
    not clear.
    """
    tree = patch.tree
    at = node.mapping
    key = node.type_key
    if not NAME.fullmatch(name) or is_word(tree.types, name):
        raise EditError(
            f"'{name}' is no name for a subtree: use lower-case letters, digits and _", node.id
        )
    subtrees = tree.top.get("subtrees") if tree.top is not None else None
    if isinstance(subtrees, YamlMapping) and name in subtrees.entries:
        raise EditError(f"there is a subtree '{name}' already", node.id)
    analysis = refuse_errors_of(tree.text, path, skills, "correct the tree first", node.id)
    inputs, outputs = _Wiring(analysis, node).ports()
    wires = ", ".join(f'{port}: "{{{port}}}"' for port in (*inputs, *outputs))
    call = f"{name}: {{{wires}}}"
    faces = [f"{word}: {{{', '.join(f'{port}: {kind}' for port, kind in ports.items())}}}"
             for word, ports in (("in", inputs), ("out", outputs)) if ports]  # fmt: skip
    entry = at.entries[key.text]
    if on_its_lines(tree, node) and not tree.is_flow(at):
        last = patch.entry_rows(*entry)[2]
        lines = [
            tree.line(key.line - 1)[key.column - 1 :],
            *(tree.line(row) for row in range(key.line, last + 1)),
        ]
        end = tree.line_end(last)
    else:
        lines = re.split(r"\r\n|[\n\r]", tree.text[tree.start(key) : tree.end(entry[1])])
        end = max(tree.end(entry[1]), tree.end(key))
    patch.replace(tree.start(key), end, call)
    body = LiftedNode((), tuple(lines), key.column - 1).indented(STEP)
    _declare(
        patch,
        [
            f"{name}:",
            *(" " * STEP + line for line in (*faces, "root:")),
            *(" " * STEP + b if b else b for b in body),
        ],
    )
    return call, "{" + ", ".join(faces) + "}"


def _declare(patch: TextPatch, lines: list[str]) -> None:
    """Put a subtree last among the file's subtrees."""
    tree = patch.tree
    top = patch.tree.top
    assert top is not None
    entry = top.entries.get("subtrees")
    if tree.is_flow(top) or (entry is not None and tree.is_flow(entry[1])):
        raise EditError("the subtrees stand in braces; edit them as text")
    if entry is not None and isinstance(entry[1], YamlMapping):
        patch.add_entry(
            entry[1], [" " * (entry[1].column - 1) + line if line else line for line in lines]
        )
        return
    lines = [" " * STEP + line if line else line for line in lines]
    if entry is not None:
        patch.insert_lines(entry[0].line, lines)
        return
    last = max(row for row in range(len(tree.starts)) if tree.line(row).strip())
    patch.insert_lines(last + 1, ["", "subtrees:", *lines])


def refuse_errors_of(
    text: str, path: Path, skills: Registry | None, why: str, node: str
) -> Analysis:
    """Return the check of a text. Raises EditError: it has an error."""
    document = read(text, path, tree_folders=[installed_trees()])
    found = analyse(document, Registry.installed() if skills is None else skills)
    if found.errors:
        error = found.errors[0]
        raise EditError(f"{why}: {error.path}, line {error.line}: {error.message}", node)
    return found


class _Wiring:
    """Names of one definition that cross the border of a node."""

    def __init__(self, analysis: Analysis, node: WrittenNode) -> None:
        self.analysis = analysis
        self.at = node
        file = analysis.document.main
        prefix = node.id.partition("root")[0]
        found = file.subtrees.get(prefix[:-1]) if prefix else file.main
        assert found is not None
        self.definition: Definition = found
        self.scope = analysis.scopes[id(found)]

    def ports(self) -> tuple[dict[str, str], dict[str, str]]:
        """Return types of the names that come in and go out."""
        assert self.definition.root is not None
        place = (self.at.type_key.line, self.at.type_key.column)
        inside = next(n for n in self.definition.root.walk() if (n.key.line, n.key.column) == place)
        core = {id(n) for child in inside.children for n in child.walk()}
        read_in: dict[str, bool] = {}  # whether a read in it needs a value
        written_in: dict[str, None] = {}
        early: dict[str, None] = {}  # read before it was written
        read_out = set(self.definition.outputs)
        written_out = set[str]()
        for node in self.definition.root.walk():
            for layer in node.layers:
                resolved = self.analysis.resolved.get((id(node), layer.key))
                if resolved is None:
                    continue
                if id(node) in core or (node is inside and layer is node.type):
                    for found in resolved.reads:
                        read_in[found.name] = read_in.get(found.name, False) or found.required
                        if found.name not in written_in:
                            early[found.name] = None
                    written_in.update(dict.fromkeys(resolved.outputs.values()))
                else:
                    read_out |= {found.name for found in resolved.reads}
                    written_out |= set(resolved.outputs.values())
        return self._inputs(read_in, written_in, early, written_out), self._outputs(
            written_in, read_out
        )

    def _inputs(
        self,
        read: dict[str, bool],
        written: dict[str, None],
        early: dict[str, None],
        elsewhere: set[str],
    ) -> dict[str, str]:
        inputs: dict[str, str] = {}
        for name, required in read.items():
            named = self.scope.names.get(name)
            if named is None or (
                named.origin in ("parameter", "constant") and name not in self.definition.inputs
            ):
                continue
            if name in written and name in early:
                message = f"'{name}' is read before it is written here, so it would come in and go out by one name"
                raise EditError(f"{message}; give one of them another name", self.at.id)
            if (named.origin == "input" or name in elsewhere) and name not in written:
                kind = self._type(name)
                may_lack = named.may_be_none or (named.origin == "written" and not required)
                inputs[name] = f"{{type: {kind}, default: none}}" if may_lack else kind
        return inputs

    def _outputs(self, written: dict[str, None], read: set[str]) -> dict[str, str]:
        return {name: self._type(name) for name in written if name in read}

    def _type(self, name: str) -> str:
        found = self.scope.names[name].type
        words = self.scope.skills.types
        word = next((word for word, kind in words.items() if kind == found), "")
        if not word:
            raise EditError(
                f"the type of '{name}' has no name that a subtree could declare", self.at.id
            )
        return word
