"""XML text → elements that know their line. No document types, no entities, limited in size and depth."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from xml.parsers import expat

from pomona.executive.values.findings import Findings, Source, Spot

MAX_CHARACTERS = 4 * 1024 * 1024
MAX_DEPTH = 200


@dataclass(slots=True, eq=False)
class XmlElement:
    """An element with its attributes, children and text."""

    source: Source
    tag: str
    attributes: dict[str, str]
    line: int
    column: int
    children: list[XmlElement] = field(default_factory=list)
    text: str = ""

    @property
    def length(self) -> int:
        """Characters of the tag, to underline."""
        return len(self.tag)

    @property
    def place(self) -> str:
        """File, line and column, for messages."""
        return f"{self.source.path}:{self.line}:{self.column}"

    def get(self, name: str) -> str:
        """Return an attribute's text; empty when it is missing."""
        return self.attributes.get(name, "")

    def all(self, tag: str) -> list[XmlElement]:
        """Return the children with this tag."""
        return [child for child in self.children if child.tag == tag]


class _Refused(Exception):
    pass


def read_xml(source: Source, findings: Findings) -> XmlElement | None:
    """Return the root element, or None when it cannot be read; the reason is a finding."""
    start = Spot(source, 1, 1)
    if len(source.text) > MAX_CHARACTERS:
        findings.error(
            start, "too-large", f"the file is larger than {MAX_CHARACTERS // 1024 // 1024} MiB"
        )
        return None
    parser = expat.ParserCreate(
        "utf-8"
    )  # the text is already decoded, so ignore the encoding of the declaration
    top: list[XmlElement] = []
    open_elements: list[XmlElement] = []

    def begin(tag: str, attributes: dict[str, str]) -> None:
        line = parser.CurrentLineNumber
        column = parser.CurrentColumnNumber + 2
        element = XmlElement(source, tag, attributes, line, column)
        if len(open_elements) >= MAX_DEPTH:
            findings.error(element, "too-deep", f"nested more than {MAX_DEPTH} levels deep")
            raise _Refused
        (open_elements[-1].children if open_elements else top).append(element)
        open_elements.append(element)

    def end(_tag: str) -> None:
        open_elements.pop()

    def characters(text: str) -> None:
        if open_elements:
            open_elements[-1].text += text

    def doctype(*_declared: object) -> None:
        findings.error(
            Spot(source, parser.CurrentLineNumber, 1), "xml", "document types are not allowed"
        )
        raise _Refused

    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.CharacterDataHandler = characters
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(_escaped(source.text).encode("utf-8", "replace"), True)
    except expat.ExpatError as error:
        where = Spot(source, error.lineno, error.offset + 1)
        findings.error(
            where, "xml", f"not XML: {expat.errors.messages.get(error.code, 'cannot be read')}"
        )
        return None
    except _Refused:
        return None
    return top[0]


def _escaped(text: str) -> str:
    """Return the text with escaped signs that BehaviorTree.CPP's reader tolerates: `a < b && c` in an attribute."""
    if not _BARE.search(text):
        return text
    return _VALUE.sub(lambda found: _BARE.sub(lambda sign: _SIGNS[sign[0]], found[0]), text)


_BARE = re.compile(r"<(?![A-Za-z/!?])|&(?!(?:#\d+|#x[0-9A-Fa-f]+|[A-Za-z]+);)")
_VALUE = re.compile(r'=\s*"[^"]*"' + r"|=\s*'[^']*'|<!--.*?-->", re.DOTALL)
_SIGNS = {"<": "&lt;", "&": "&amp;"}
