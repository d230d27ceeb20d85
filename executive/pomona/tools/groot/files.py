"""The trees and models of an XML file, of the files that it includes, and of others that are read with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pomona.executive.values.findings import Findings, Source
from pomona.executive.values.plain_text import read_plain_text
from pomona.tools.groot.version_3 import modernise
from pomona.tools.groot.xml_nodes import MAX_CHARACTERS, XmlElement, read_xml

MAX_FILES = 100


@dataclass(slots=True)
class Forest:
    """The trees and models of the files."""

    findings: Findings
    main: str = ""  # the tree that runs; empty when there is none
    # by ID. A later one replaces an earlier one, and a file's own one replaces an included one.
    trees: dict[str, XmlElement] = field(default_factory=dict)
    models: dict[str, XmlElement] = field(default_factory=dict)  # of subtrees, by ID
    nodes: dict[str, XmlElement] = field(default_factory=dict)  # models of foreign nodes, by ID
    described: dict[str, XmlElement] = field(
        default_factory=dict
    )  # models of nodes in the files of the trees, by ID
    conditions: set[str] = field(
        default_factory=set
    )  # foreign nodes that end in the tick in which they start
    versions: dict[str, str] = field(
        default_factory=dict
    )  # `4` or `3` by file; empty where nothing shows it
    exported: set[str] = field(default_factory=set)  # files that Pomona has written
    texts: list[str] = field(default_factory=list)  # of all files
    including: list[Path] = field(default_factory=list)

    def read(self, files: Sequence[tuple[str, str | Path]], main: str = "") -> None:
        """Read texts with their paths. The main tree is `main`, the one that the first text names, or one without
        callers.
        """
        roots = [root for text, path in files if (root := self.file(text, path)) is not None]
        if len(roots) < len(files):
            return
        first = roots[0]
        own = [
            tree.get("ID") or _numbered(number)
            for number, tree in enumerate(first.all("BehaviorTree"), start=1)
        ]
        called = {name for tree in self.trees.values() for name in _called(tree)}
        free = [name for name in own if name not in called] or own or list(self.trees)
        self.main = main or first.get("main_tree_to_execute") or next(iter(free), "")
        if not self.main:
            self.findings.error(first, "xml", "the file holds no <BehaviorTree>")
        elif self.main not in self.trees:
            self.findings.error(first, "xml", f"the main tree '{self.main}' is not in the file")
            self.main = ""
        elif len(free) > 1 and not (main or first.get("main_tree_to_execute")):
            message = f"the file does not name the main tree: '{self.main}' is taken"
            self.findings.warning(
                first, "xml", message, f"others: {', '.join(free[1:])}; choose with --main"
            )

    def read_models(self, text: str, path: str | Path) -> None:
        """Read the nodes and their ports: the `<TreeNodesModel>` of a file."""
        root = read_xml(Source(str(path), text), self.findings)
        groups = (
            []
            if root is None
            else [root]
            if root.tag == "TreeNodesModel"
            else root.all("TreeNodesModel")
        )
        if root is not None and not groups:
            self.findings.error(root, "xml", "the file holds no <TreeNodesModel>")
        for group in groups:
            self.nodes.update(
                {model.get("ID"): model for model in group.children if model.tag != "SubTree"}
            )
            self.conditions.update(model.get("ID") for model in group.all("Condition"))

    def file(self, text: str, path: str | Path) -> XmlElement | None:
        """Return the root of one file, when it is BehaviorTree.CPP's; its trees are taken."""
        root = read_xml(Source(str(path), text), self.findings)
        if root is None:
            return None
        if root.tag != "root":
            self.findings.error(
                root, "xml", "the file is not BehaviorTree.CPP's: its first element is not <root>"
            )
            return None
        if root.get("BTCPP_format") not in (
            "",
            "4",
        ):  # without it BehaviorTree.CPP takes the file for one of version 4
            self.findings.error(
                root, "version", 'only version 4 of the format is read: <root BTCPP_format="4">'
            )
            return None
        self.texts.append(text)
        self.versions[str(path)] = root.get("BTCPP_format") or modernise(root)
        self.including.append(Path(path).absolute())
        for element in root.all("include"):
            self.include(element, Path(path))
        self.including.pop()
        for group in root.all("TreeNodesModel"):
            self.models.update({model.get("ID"): model for model in group.all("SubTree")})
            self.described.update(
                {model.get("ID"): model for model in group.children if model.tag != "SubTree"}
            )
            if any(own_metadata(model) is not None for model in group.all("SubTree")):
                self.exported.add(str(path))
            self.conditions.update(model.get("ID") for model in group.all("Condition"))
        for number, tree in enumerate(root.all("BehaviorTree"), start=1):
            name = tree.get("ID") or _numbered(number)
            other = self.trees.setdefault(name, tree)
            if other is not tree and other.place != tree.place:  # not the same file, included twice
                words = f"there is another tree '{name}', in {other.place}; the first one is read"
                self.findings.error(tree, "xml", words, "rename one of them, and its <SubTree>")
        return root

    def is_exported(self, element: XmlElement) -> bool:
        """Return True if Pomona has written the element: its attributes may hold expressions, as in tree files."""
        return element.source.path in self.exported

    def version(self, element: XmlElement) -> str:
        """Return the version of the element's file: declared, or shown by its words; empty for either."""
        return self.versions.get(element.source.path, "")

    def directions(self, node: str) -> dict[str, str]:
        """Return `input`, `output` or `inout` of a foreign node's ports, as far as a model has them."""
        model = self.nodes.get(node) or self.described.get(node)
        return (
            {}
            if model is None
            else {port.get("name"): port.tag.removesuffix("_port") for port in ports_of(model)}
        )

    def include(self, element: XmlElement, path: Path) -> None:
        """Read the file that an `<include>` names; relative to its own file's folder."""
        shown = element.get("path")
        if element.get("ros_pkg"):
            self.findings.error(
                element,
                "xml",
                "<include> names a ROS package, which is not looked for",
                "use a path",
            )
            return
        found = path.parent / shown
        try:
            text = read_plain_text(found, MAX_CHARACTERS) if shown else None
        except (OSError, ValueError):
            text = None
        if text is None:
            self.findings.error(element, "file", f"<include> names '{shown}', which cannot be read")
        elif any(found.samefile(other) for other in self.including if other.is_file()):
            self.findings.error(element, "recursion", f"'{shown}' includes itself")
        elif len(self.texts) >= MAX_FILES:
            self.findings.error(element, "too-large", f"at most {MAX_FILES} files are read")
        else:
            self.file(text, found)


def ports_of(model: XmlElement) -> list[XmlElement]:
    """Return the elements of a model that declare ports."""
    return [
        port for port in model.children if port.tag in ("input_port", "output_port", "inout_port")
    ]


def own_metadata(model: XmlElement) -> XmlElement | None:
    """Return the metadata that Pomona's export has written into the model of a subtree."""
    written = (found for fields in model.all("MetadataFields") for found in fields.all("Metadata"))
    return next((found for found in written if found.get("pomona")), None)


def _called(element: XmlElement) -> Iterator[str]:
    if element.tag == "SubTree":
        yield element.get("ID")
    for child in element.children:
        yield from _called(child)


def _numbered(number: int) -> str:
    return f"tree_{number}"
