"""The trees and models of an XML file, of the files that it includes, and of others that are read with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pomona.executive.values.findings import Findings, Source
from pomona.executive.values.plain_text import read_plain_text
from pomona.tools.groot.xml_nodes import MAX_CHARACTERS, XmlElement, read_xml

MAX_FILES = 100
PORTS = ("input_port", "output_port", "inout_port")
_CONVERT = (
    'write BTCPP_format="4" if the file is of version 4; BehaviorTree.CPP\'s convert_v3_to_v4.py converts '
    "files of version 3"
)


@dataclass(slots=True)
class Forest:
    """The trees and models of the files, by ID. A file's own tree and an included one may not share an ID."""

    findings: Findings
    main: str = ""  # the tree that runs; empty when there is none
    trees: dict[str, XmlElement] = field(default_factory=dict)
    subtrees: dict[str, XmlElement] = field(default_factory=dict)  # models of subtrees
    models: dict[str, XmlElement] = field(default_factory=dict)  # models of all other nodes
    texts: list[str] = field(default_factory=list)  # of all files
    including: list[Path] = field(default_factory=list)

    def read(self, files: Sequence[tuple[str, str | Path]], main: str = "") -> None:
        """Read texts with their paths. The main tree is `main`, the one that the first text names, or one without
        callers.
        """
        roots = [self.file(text, path) for text, path in files]
        first = roots[0]
        if first is None or None in roots:
            return
        named = main or first.get("main_tree_to_execute")
        own = [tree.get("ID") for tree in first.all("BehaviorTree")]
        called = {name for tree in self.trees.values() for name in _called(tree)}
        free = [name for name in own if name not in called] or own
        self.main = named or next(iter(free), "")
        if self.main not in self.trees:
            words = f"the main tree '{self.main}' is not in the file" if self.main else "no tree"
            self.findings.error(first, "xml", f"{words}: a <BehaviorTree> with an ID is needed")
            self.main = ""
        elif len(free) > 1 and not named:
            message = f"the file does not name the main tree: '{self.main}' is taken"
            others = f"others: {', '.join(free[1:])}; choose with --main"
            self.findings.warning(first, "xml", message, others)

    def file(self, text: str, path: str | Path) -> XmlElement | None:
        """Return the root of one file, when it is BehaviorTree.CPP's; its trees and models are taken."""
        root = read_xml(Source(str(path), text), self.findings)
        if root is None:
            return None
        if root.tag != "root":
            words = "the file is not BehaviorTree.CPP's: its first element is not <root>"
            self.findings.error(root, "xml", words)
            return None
        trees = root.all("BehaviorTree")
        if trees and root.get("BTCPP_format") != "4":
            words = 'only version 4 of the format is read: <root BTCPP_format="4">'
            self.findings.error(root, "version", words, _CONVERT)
            return None
        self.texts.append(text)
        self.including.append(Path(path).absolute())
        for element in root.all("include"):
            self.include(element, Path(path))
        self.including.pop()
        for model in (model for group in root.all("TreeNodesModel") for model in group.children):
            kind = self.subtrees if model.tag == "SubTree" else self.models
            kind[model.get("ID")] = model
        for tree in trees:
            name = tree.get("ID")
            other = self.trees.setdefault(name, tree)
            if not name or (other is not tree and other.place != tree.place):
                words = f"there is another tree '{name}', in {other.place}" if name else "no ID"
                self.findings.error(tree, "xml", words, "give the tree an ID of its own")
        return root

    def include(self, element: XmlElement, path: Path) -> None:
        """Read the file that an `<include>` names; relative to its own file's folder."""
        shown = element.get("path")
        found = path.parent / shown
        try:
            text = read_plain_text(found, MAX_CHARACTERS) if shown else None
        except (OSError, ValueError):
            text = None
        if element.get("ros_pkg"):
            words = "<include> names a ROS package, which is not looked for"
            self.findings.error(element, "xml", words, "write the path of the file alone")
        elif text is None:
            self.findings.error(element, "file", f"<include> names '{shown}', which cannot be read")
        elif any(found.samefile(other) for other in self.including if other.is_file()):
            self.findings.error(element, "recursion", f"'{shown}' includes itself")
        elif len(self.texts) >= MAX_FILES:
            self.findings.error(element, "too-large", f"at most {MAX_FILES} files are read")
        else:
            self.file(text, found)

    def directions(self, node: str) -> dict[str, str]:
        """Return `input`, `output` or `inout` of a foreign node's ports, as far as a model has them."""
        model = self.models.get(node)
        ports = [] if model is None else ports_of(model)
        return {port.get("name"): port.tag.removesuffix("_port") for port in ports}


def ports_of(model: XmlElement) -> list[XmlElement]:
    """Return the elements of a model that declare ports."""
    return [port for port in model.children if port.tag in PORTS]


def _called(element: XmlElement) -> Iterator[str]:
    if element.tag == "SubTree":
        yield element.get("ID")
    for child in element.children:
        yield from _called(child)
