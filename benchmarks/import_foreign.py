"""Foreign trees that `pomona import` carries over: files of XML, and XML in C++ sources and documentation.

    git clone https://github.com/BehaviorTree/BehaviorTree.CPP ../btcpp
    python -m benchmarks.import_foreign ../btcpp

Every whole tree (a text with `<root>` and `<BehaviorTree>`) is imported, read and checked with a stand-in for each
skill, exported, and imported again. It is carried over when nothing was refused, the check finds no mistake, and the
second import gives the same text as the first. Trees that a text calls and does not hold are taken from the other texts
of its file. Trees that BehaviorTree.CPP refuses itself (its tests of bad input) do not count; how many there are, and
why, is printed. Nothing of a foreign tree is kept.
"""

from __future__ import annotations

import argparse
import collections
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pomona.executive.language import check, read
from pomona.executive.language.model import Document
from pomona.executive.nodes.leaves import SKILL
from pomona.executive.ports import Port, Ports
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Finding, Findings, Source, TreeFileError
from pomona.executive.values.yaml_nodes import YamlScalar
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.groot.import_xml import import_groot
from pomona.tools.groot.xml_nodes import XmlElement, read_xml

_CPP = re.compile(
    r'(?P<skip>//[^\n]*|/\*.*?\*/|\s+)|R"(?P<mark>[^()\s\\"]{0,16})\((?P<raw>.*?)\)(?P=mark)"'
    r'|"(?P<quoted>(?:[^"\\\n]|\\.)*)"|\'(?:[^\'\\\n]|\\.)+\'|.',
    re.DOTALL,
)
_FENCED = re.compile(r"```\w*\n(.*?)```", re.DOTALL)
_OF_THE_PROGRAM = {"unset", "unread", "unused", "unwritten", "unknown-name"}
"""Findings about values that the program around a foreign tree writes or reads."""
_CONTROLS = frozenset(
    [
        "Sequence", "AsyncSequence", "SequenceWithMemory", "ReactiveSequence", "Fallback", "AsyncFallback",
        "ReactiveFallback", "Parallel", "ParallelAll", "IfThenElse", "WhileDoElse", "TryCatch", "Switch2", "Switch3",
        "Switch4", "Switch5", "Switch6", "ManualSelector",
    ]
)  # fmt: skip
_DECORATORS = frozenset(
    [
        "Inverter", "ForceSuccess", "ForceFailure", "Repeat", "RetryUntilSuccessful", "KeepRunningUntilFailure",
        "Delay", "Timeout", "RunOnce", "Precondition", "LoopInt", "LoopDouble", "LoopBool", "LoopString",
        "SkipUnlessUpdated", "WaitValueUpdate",
    ]
)  # fmt: skip
_CHILDREN = {"IfThenElse": (2, 3), "WhileDoElse": (2, 3), "TryCatch": (2, 10**6)}
_WIRE = re.compile(r"\{\w+\}")
_BY_ID = ("Action", "Condition", "Control", "Decorator", "SubTree")


@dataclass(frozen=True)
class Foreign:
    """A whole tree, and where it stands."""

    path: Path
    line: int
    text: str


@dataclass
class ForeignTrees:
    """Results for the trees of a folder: places by reason."""

    carried: list[str] = field(default_factory=list)
    refused: dict[str, list[str]] = field(default_factory=lambda: collections.defaultdict(list))
    no_trees: dict[str, list[str]] = field(default_factory=lambda: collections.defaultdict(list))

    def print(self, where: bool) -> None:
        """Write the table."""
        lost = len({place for places in self.refused.values() for place in places})
        total = len(self.carried) + lost
        print(
            f"{total} trees, {len(self.carried)} carried over ({len(self.carried) / max(total, 1):.1%}), {lost} refused"
        )
        for title, found in (("refused", self.refused), ("not counted", self.no_trees)):
            for reason, places in sorted(found.items(), key=lambda item: -len(item[1])):
                print(f"  {title}: {len(places):4d}  {reason}")
                if where:
                    print("".join(f"{'':20}{place}\n" for place in places), end="")


def trees_in(folder: Path) -> Iterator[Foreign]:
    """Every text with a `<root>` and a `<BehaviorTree>` below a folder."""
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        if path.suffix not in (".xml", ".cpp", ".h", ".hpp", ".md", ".rst"):
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        for line, found in _texts(path.suffix, text):
            if "<root" in found and "<BehaviorTree" in found:
                yield Foreign(path, line, found)


def _texts(suffix: str, text: str) -> Iterator[tuple[int, str]]:
    if suffix == ".xml":
        yield 1, text
    elif suffix in (".md", ".rst"):
        for match in _FENCED.finditer(text):
            yield text.count("\n", 0, match.start()) + 2, match[1]
    else:
        yield from _cpp_strings(text)


def _cpp_strings(text: str) -> Iterator[tuple[int, str]]:
    """Literals, those that stand beside each other as one."""
    parts: list[str] = []
    line = 0
    for match in _CPP.finditer(text):
        if match["skip"] is not None:
            continue
        if match["raw"] is None and match["quoted"] is None:
            if parts:
                yield line, "".join(parts)
            parts = []
            continue
        line = line if parts else text.count("\n", 0, match.start()) + 1
        parts.append(
            match["raw"]
            if match["raw"] is not None
            else re.sub(r"\\(.)", _unescaped, match["quoted"])
        )
    if parts:
        yield line, "".join(parts)


def _unescaped(escape: re.Match[str]) -> str:
    return {"n": "\n", "t": "\t"}.get(escape[1], escape[1])


def refused_by_the_original(tree: Foreign, others: Sequence[Foreign]) -> str:
    """Why BehaviorTree.CPP does not take a text (the rules of its `VerifyXML`); empty when it does."""
    root = read_xml(Source(str(tree.path), tree.text), Findings())
    if root is None:
        return "no XML"
    if root.tag != "root":
        return "its first element is not <root>"
    trees = root.all("BehaviorTree")
    for behaviour_tree in trees:
        if len(behaviour_tree.children) != 1:
            return "a <BehaviorTree> that has not one child"
        if len(root.children) > 1 and not behaviour_tree.get("ID"):
            return "several trees, one without an ID"
        reason = next(filter(None, map(_bad_element, _walk(behaviour_tree.children[0]))), "")
        if reason:
            return reason
    known = "".join([tree.text, *(text for text, _ in beside(tree, others))])
    if not root.all("include") and any(
        f'<BehaviorTree ID="{called}"' not in known for called in missing_in(tree)
    ):
        return "calls a tree that is nowhere"
    calls = {
        found.get("ID"): {e.get("ID") for e in _walk(found) if e.tag == "SubTree"}
        for found in trees
    }
    if any(_reaches(calls, name, name, set()) for name in calls):
        return "a tree that calls itself"
    if root.get("BTCPP_format") == "3":
        return "written for version 3"
    main = root.get("main_tree_to_execute")
    if main and not root.all("include") and main not in [found.get("ID") for found in trees]:
        return "a main tree that is not there"
    return ""


def _bad_element(element: XmlElement) -> str:
    children, name = (
        len(element.children),
        element.get("ID") if element.tag in _BY_ID else element.tag,
    )
    if not name:
        return "a node without an ID"
    if re.search(r"[\s<>&\"'/\\:*?|.]", name):
        return "a name with signs that are not allowed"
    if element.tag == "SubTree" and children:
        return "a <SubTree> with children"
    if element.tag in ("Action", "Condition") and children:
        return "a leaf with children"
    if name in _DECORATORS and children != 1:
        return f"a <{name}> that has not one child"
    fewest, most = _CHILDREN.get(name, (int(name in _CONTROLS), 10**6))
    return "" if fewest <= children <= most else f"a <{name}> with {children} children"


def _reaches(calls: Mapping[str, set[str]], start: str, goal: str, seen: set[str]) -> bool:
    below = calls.get(start, set()) - seen
    return goal in below or any(_reaches(calls, name, goal, seen | below) for name in below)


def _walk(element: XmlElement) -> Iterator[XmlElement]:
    yield element
    for child in element.children:
        yield from _walk(child)


def stand_ins(document: Document, writes: bool = True) -> Registry:
    """A skill for every name that a document uses; a port that is wired wherever it stands writes, unless none does."""
    ports: dict[str, set[str]] = collections.defaultdict(set)
    inputs: dict[str, set[str]] = collections.defaultdict(set)
    for definition in document.definitions():
        for node in definition.root.walk() if definition.root is not None else ():
            if node.type is SKILL:
                ports[node.key.text].update(node.ports)
                wired = {
                    n
                    for n, (_, v) in node.ports.items()
                    if isinstance(v, YamlScalar) and _WIRE.fullmatch(v.text)
                }
                inputs[node.key.text].update(node.ports.keys() - (wired if writes else set()))
    return Registry(
        {name: _stand_in(name, inputs[name], found - inputs[name]) for name, found in ports.items()}
    )


def _stand_in(name: str, inputs: Iterable[str], outputs: Iterable[str]) -> type[Skill]:
    body = {
        "inputs": Ports(**{port: Port(object, default=None) for port in sorted(inputs)}),
        "outputs": Ports(**{port: Port(object) for port in sorted(outputs)}),
        "failures": ("FAILED",),
        "run": lambda self, **given: None,
    }
    return type(name, (Skill,), body)


def missing_in(tree: Foreign) -> set[str]:
    """IDs of subtrees that a text calls and does not hold."""
    held, called = (
        set(re.findall(rf'<{tag}\b[^>]*\bID="([^"]*)"', tree.text))
        for tag in ("BehaviorTree", "SubTree")
    )
    return called - held


def beside(tree: Foreign, others: Sequence[Foreign]) -> list[tuple[str, Path]]:
    """Return texts of the same file with the called trees: for each the nearest, and its own callees."""
    found: list[Foreign] = []
    wanted = sorted(missing_in(tree))
    while wanted:
        name = wanted.pop()
        holders = [o for o in others if o is not tree and f'<BehaviorTree ID="{name}"' in o.text]
        holder = min(holders, key=lambda other: abs(other.line - tree.line), default=None)
        if holder is not None and holder not in found:
            found.append(holder)
            wanted += sorted(missing_in(holder))
    return [(other.text, other.path) for other in found]


def attempt(tree: Foreign, others: Sequence[Foreign]) -> list[str]:
    """Why a tree is not carried over: nothing when it is."""
    text, findings = import_groot(tree.text, tree.path, beside=beside(tree, others))
    if findings:
        return sorted({_reason(finding) for finding in findings})
    document = read(text, tree.path.with_suffix(".yaml"))
    skills = stand_ins(document)
    found = [f for f in check(document, skills) if f.severity == "error" and not _of_the_program(f)]
    if found:
        return sorted({f"check: {finding.code}: {finding.message}" for finding in found})
    try:
        xml = export_groot(document, skills)
    except TreeFileError as error:
        return [f"export: {finding.message}" for finding in error.findings]
    again, findings = import_groot(xml, tree.path)
    return [] if again == text and not findings else ["import → export → import is no fixed point"]


def _of_the_program(finding: Finding) -> bool:
    """Whether it is about a value that the program around a foreign tree writes or reads, or an enum that it knows."""
    return finding.code in _OF_THE_PROGRAM or finding.message.startswith("nothing writes")


def _reason(finding: Finding) -> str:
    return re.sub(r"'[^']*'", "'…'", finding.message)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="+", help="a checkout of a foreign repository")
    parser.add_argument("--where", action="store_true", help="also print files and lines")
    order = parser.parse_args()
    for folder in order.folder:
        table = ForeignTrees()
        trees = list(trees_in(folder))
        for tree in trees:
            place = f"{tree.path.relative_to(folder)}:{tree.line}"
            others = [other for other in trees if other.path == tree.path]
            reason = refused_by_the_original(tree, others)
            if reason:
                table.no_trees[reason].append(place)
                continue
            reasons = attempt(tree, others)
            for reason in reasons:
                table.refused[reason].append(place)
            if not reasons:
                table.carried.append(place)
        print(folder)
        table.print(order.where)
    return 0


if __name__ == "__main__":
    sys.exit(main())
