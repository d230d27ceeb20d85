"""Changes that a person asks for: `height=120 mm` of a parameter or option, `Detect.score=0.4` of a node."""

from __future__ import annotations

from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder
from pomona.executive.judging import Judged
from pomona.executive.values.findings import did_you_mean
from pomona.tools.library.cures.change import SingleChange
from pomona.tools.library.cures.knobs import Knob, Knobs


def asked_change(text: str, order: RunOrder, judged: Judged) -> SingleChange:
    """Return the change that a text `NAME=VALUE` asks for.

    Raises UsageError: there is no such place, more than one, or it holds no single value.
    """
    name, equals, value = text.partition("=")
    name = name.strip()
    value = value.strip()
    if not (name and equals and value):
        raise UsageError(
            f"--set {text}: write NAME=VALUE, with a parameter, an option or NODE.port as the name"
        )
    cell = judged.cell
    knobs = Knobs(
        judged.analysis, order.settings, cell.options if cell is not None else (), str(order.cell),
        order.texts.get(str(order.cell), ""),
    )  # fmt: skip
    knob = _of_node(name, knobs) if "." in name else knobs.parameter(name) or knobs.option(name)
    if knob is None:
        known = [
            *judged.analysis.document.main.parameters,
            *(option.name for option in knobs.options),
        ]
        hint = did_you_mean(name, known) or f"known: {', '.join(known) or 'none'}"
        raise UsageError(f"--set {text}: neither the tree nor the cell has '{name}': {hint}")
    return knob.changed(value, 1.0)


def _of_node(name: str, knobs: Knobs) -> Knob:
    label, _, slot = name.rpartition(".")
    found: dict[tuple[str, int], Knob] = {}
    has: list[str] = []
    for node in knobs.nodes():
        if label not in (node.label, node.key.text):
            continue
        for layer, resolved in knobs.layers(node):
            slots = knobs.slots(layer, resolved)
            has += slots
            knob = knobs.slot(node, layer, resolved, slot) if slot in slots else None
            if knob is not None:
                found[knob.path, knob.start] = knob
    if len(found) == 1:
        return next(iter(found.values()))
    if found:
        lines = ", ".join(str(knob.line) for knob in found.values())
        raise UsageError(
            f"--set {name}: {len(found)} nodes are meant, in lines {lines}: use the name of one"
        )
    if not has:
        raise UsageError(f"--set {name}: the tree has no node '{label}' with ports")
    if slot in has:
        raise UsageError(
            f"--set {name}: it is wired, or holds no single value: change the parameter that it reads"
        )
    raise UsageError(
        f"--set {name}: {label} has no '{slot}': {did_you_mean(slot, has) or ', '.join(has)}"
    )
