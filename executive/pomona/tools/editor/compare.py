"""Changes between two versions of a tree file, for `pomona run --watch`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pomona.executive.language.model import Declared, Definition, Document, TreeNode
from pomona.executive.values.yaml_nodes import written


def changes(before: Document, after: Document) -> list[str]:
    """One line for each difference in meaning: parameters, ports, nodes. Comments and layout do not count."""
    return list(_changes(before, after))


def _changes(before: Document, after: Document) -> Iterator[str]:
    for what in ("parameters", "constants"):
        word = what.removesuffix("s")
        old, new = getattr(before.main, what), getattr(after.main, what)
        yield from _mappings(word, {n: _declared(d) for n, d in old.items()}, {n: _declared(d) for n, d in new.items()})
    olds = {_title(d): d for d in before.definitions()}
    news = {_title(d): d for d in after.definitions()}
    for title in (*news, *(t for t in olds if t not in news)):
        if title not in olds:
            yield f"{title} is new"
        elif title not in news:
            yield f"{title} is gone"
        else:
            yield from _definitions(title, olds[title], news[title])


def _title(definition: Definition) -> str:
    return f"tree {definition.name}" if definition.main else f"subtree {definition.name}"


def _definitions(title: str, before: Definition, after: Definition) -> Iterator[str]:
    for word in ("inputs", "outputs"):
        old, new = getattr(before, word), getattr(after, word)
        yield from _mappings(
            f"{title}: {word.removesuffix('s')}",
            {n: _declared(d) for n, d in old.items()},
            {n: _declared(d) for n, d in new.items()},
        )
    old_nodes, new_nodes = dict(_nodes(before)), dict(_nodes(after))
    for path in (*new_nodes, *(p for p in old_nodes if p not in new_nodes)):
        if path not in old_nodes:
            yield f"{title}: {path} is new"
        elif path not in new_nodes:
            yield f"{title}: {path} is gone"
        else:
            yield from _mappings(f"{title}: {path}", old_nodes[path], new_nodes[path])
    if list(old_nodes) != list(new_nodes) and sorted(old_nodes) == sorted(new_nodes):
        yield f"{title}: nodes are in another order"


def _mappings(what: str, before: Mapping[str, str], after: Mapping[str, str]) -> Iterator[str]:
    for name in (*after, *(n for n in before if n not in after)):
        if name not in before:
            yield f"{what} {name}: {after[name]} (new)"
        elif name not in after:
            yield f"{what} {name} is gone"
        elif before[name] != after[name]:
            yield f"{what} {name}: {before[name]} → {after[name]}"


def _declared(declared: Declared) -> str:
    parts = [declared.type.text] if declared.type is not None else []
    for name in ("default", "min", "max"):
        node = getattr(declared, name)
        if node is not None:
            parts.append(f"{name} {written(node)}" if parts else written(node))
    if declared.choices:
        parts.append("one of " + ", ".join(choice.text for choice in declared.choices))
    return ", ".join(parts)


def _nodes(definition: Definition) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield every node by a path of labels, with its written values."""
    if definition.root is not None:
        yield from _below(definition.root, "root", {})


def _below(node: TreeNode, path: str, taken: dict[str, int]) -> Iterator[tuple[str, dict[str, str]]]:
    taken[path] = taken.get(path, 0) + 1
    if taken[path] > 1:
        path = f"{path}#{taken[path]}"
    facts = {"type": node.key.text}
    facts.update({name: written(value) for name, (_, value) in node.ports.items()})
    for layer in node.layers:
        for slot, field in layer.slots.items():
            entry = node.entry(layer, slot)
            if entry is not None and not field.nodes and not field.wires:
                facts[slot] = written(entry[1])
    yield path, facts
    for child in node.children:
        yield from _below(child, f"{path}/{child.label}" if path != "root" else child.label, taken)
    for slot, part in node.parts.items():
        yield from _below(part, f"{path}:{slot}", taken)
