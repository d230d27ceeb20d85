"""Explanation of a YAML parser's error: the line at fault, its correct column, or the unclosed bracket."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

from pomona.executive.values.findings import Edit, Findings, Source, Spot

MAX_DEPTH = 80  # levels of lists and mappings in one file
TOO_DEEP = f"nested more than {MAX_DEPTH} levels deep"
_FLOW = re.compile(
    r"""(?<!\w)"(?:\\.|[^"\\])*(?:"|\Z)|(?<!\w)'(?:''|[^'])*(?:'|\Z)|(?<!\S)#.*|[\[\]{}]"""
)
_DEEPER = {"[": 1, "{": 1, "]": -1, "}": -1}
"""A quoted scalar (closed or not), a comment, or a bracket of a flow collection."""
_CLOSING = {"{": "}", "[": "]"}
_KEY = re.compile(r"""("[^"]*"|'[^']*'|[^\s\-"'#\[\]{}][^:#]*?)\s*:(?=\s|$)""")
_WIRE = re.compile(r"""["']\{[A-Za-z_]\w*\}""")
_BLOCK_SCALAR = re.compile(r":\s+[|>][-+0-9]*\s*(#.*)?$")


class _Block(NamedTuple):
    """An open list or mapping: its column, its newest key, and the key that holds the list."""

    column: int
    is_list: bool
    name: str


def report_unreadable(
    source: Source, error: Any, findings: Findings, modifiers: Collection[str] = ()
) -> None:
    """Report why a text is not YAML, from the parser's error with marks.

    `modifiers` are words that stand beside a node's type in this kind of file.
    """
    mark = error.problem_mark or error.context_mark
    line, column = (mark.line + 1, mark.column + 1) if mark is not None else (1, 1)
    tab = _tab_at(source, line, column)
    if tab:
        message = "a tab indents this line, and YAML indents with spaces only"
        hint = "put spaces in its place; your editor can show it"
        findings.error(Spot(source, line, tab), "tab", message, hint)
        return
    deep = _too_deep_at(source.text)
    if deep is not None:
        findings.error(Spot(source, *deep), "too-deep", TOO_DEEP)
        return
    opened = error.context_mark if error.context and "block" not in error.context else None
    first = opened.line + 1 if opened is not None else line
    for found in (
        _unclosed_quote(source, first, line),
        _unclosed_bracket(source, opened, line) if opened is not None else None,
        _comma_or_bracket(source, error.problem or "", line, column),
        _item_among_keys(source, line),
        _missing_mark(source, first, line, column),
        _misplaced(source, line, modifiers),
    ):
        if found is not None:
            spot, message, edits = found
            findings.error(spot, "yaml", message, edits=edits)
            return
    context = f"{error.context}, " if error.context else ""
    hint = (
        'values with braces, colons or # stand in quotes: "{name}"'
        if "{" in source.excerpt(line)
        else ""
    )
    problem = f"not YAML: {context}{error.problem or 'cannot be read'}"
    if _CURVED & set(source.excerpt(line)):
        problem = "curved quotes do not quote in YAML"
        hint = 'write straight ones: "{name}"'
    if source.text.startswith("%YAML:1.0"):
        problem = "this is a file of OpenCV's FileStorage, and no YAML"
        hint = "name it intrinsics.yaml beside frames"
    findings.error(Spot(source, line, column), "yaml", problem, hint)


FALSE_SPACES = {
    "\u00a0": "no-break space",
    "\u2002": "en space",
    "\u2003": "em space",
    "\u2007": "figure space",
    "\u2009": "thin space",
    "\u200b": "zero width space",
    "\u202f": "narrow no-break space",
    "\u3000": "ideographic space",
}
"""Characters that look like spaces, as pages and chats write them, and are none in YAML; by their names in Unicode."""


def report_false_spaces(source: Source, findings: Findings) -> bool:
    """Report every line with a character that only looks like a space; True when there is one.

    In quotes, in comments and in texts of several lines (`|`, `>`) they are part of a text.
    """
    # indentation of the key to which a text of several lines belongs
    found = False
    text_of = -1
    plain_text = _FLOW.sub(lambda match: re.sub(r"[^\n\[\]{}]", " ", match[0]), source.text)
    for line, (text, plain) in enumerate(
        zip(source.text.split("\n"), plain_text.split("\n"), strict=True), start=1
    ):
        indentation = len(text) - len(text.lstrip(" "))
        if text.strip() and text_of >= 0 and indentation <= text_of:
            text_of = -1
        if text_of >= 0:
            continue
        places = [at for at, sign in enumerate(plain, start=1) if sign in FALSE_SPACES]
        if places:
            sign = plain[places[0] - 1]
            found = True
            message = f"U+{ord(sign):04X} ({FALSE_SPACES[sign]}) is no space in YAML: put a space in its place"
            edits = [Edit(line, at, 1, "" if plain[at - 1] == "\u200b" else " ") for at in places]
            findings.error(
                Spot(source, line, places[0]),
                "space",
                message,
                "in a text, put it in quotes",
                edits,
            )
        if _BLOCK_SCALAR.search(text):
            text_of = indentation
    return found


_CURVED = frozenset("\u201c\u201d\u201e\u2018\u2019")
_Found = tuple[Spot, str, list[Edit]]


def _unclosed_quote(source: Source, first: int, last: int) -> _Found | None:
    for line in range(first, last + 1):
        text = source.excerpt(line)
        for match in _FLOW.finditer(text):
            quote = match[0][0]
            if quote in "\"'" and (len(match[0]) == 1 or not match[0].endswith(quote)):
                wire = _WIRE.match(match[0])
                edits = (
                    [Edit(line, match.start() + wire.end() + 1, 0, quote)]
                    if wire is not None
                    else []
                )
                where = (
                    f"add {quote} behind {wire[0][1:]}"
                    if wire is not None
                    else "add one where the text ends"
                )
                message = f"the {quote} that opens here is not closed: {where}"
                return Spot(source, line, match.start() + 1, len(match[0])), message, edits
    return None


def _unclosed_bracket(source: Source, opened: Any, line: int) -> _Found | None:
    """Return the opening bracket of a collection that does not end before a line."""
    start = opened.line + 1
    text = source.excerpt(opened.line + 1)
    bracket = text[opened.column : opened.column + 1]
    if bracket not in _CLOSING or start == line:
        return None
    missing = ""
    end = len(text.rstrip())
    for match in _FLOW.finditer(text):
        if match[0][0] == "#":
            end = len(text[: match.start()].rstrip())
        elif match[0] in _CLOSING:
            missing = _CLOSING[match[0]] + missing
        elif match[0] in "]}":
            missing = missing[1:]
    if not missing:
        return None
    here = line == start + 1 and not text[:end].endswith(",")
    edits = [Edit(start, end + 1, 0, missing)] if here else []
    where = (
        f"add {missing} at the end of the line"
        if here
        else f"add {_CLOSING[bracket]} where it ends"
    )
    message = f"the {bracket} that opens here is not closed: {where}"
    return Spot(source, start, opened.column + 1), message, edits


def _comma_or_bracket(source: Source, problem: str, line: int, column: int) -> _Found | None:
    """Return a comma that is missing inside a flow collection, or a comma or bracket too many behind one."""
    text = source.excerpt(line)
    here = text[column - 1 : column]
    before = text[: column - 1].rstrip()
    if "expected ','" in problem:
        word = (
            re.search(r"\s(\w+)$", before) if here == ":" else re.match(r"\w+", text[column - 1 :])
        )
        if word is None:
            return None
        at = word.start(1) if here == ":" else column - 1
        name = word[0].strip()
        return (
            Spot(source, line, at + 1, len(name)),
            f"a comma is missing before '{name}'",
            [Edit(line, len(text[:at].rstrip()) + 1, 0, ",")],
        )
    if here in ("}", "]") or (here == "," and before.endswith(("}", "]"))):
        message = f"this '{here}' is one too many: delete it"
        return Spot(source, line, column), message, [Edit(line, column, 1, "")]
    return None


def _missing_mark(source: Source, first: int, line: int, column: int) -> _Found | None:
    """Return a colon that is missing behind a word, a space behind a colon, or quotes around a value with a colon."""
    for number in (first, _line_before(source, line)):
        text = source.excerpt(number)
        match = re.match(r"(\s*(?:- +)*)(\w+)(:(?=[^\s:])|\s+(?=\S)|\s*$)", text)
        if match is None or _KEY.search(text) is not None:
            continue
        at = match.end(2) + 1
        word = match[2]
        if match[3] == ":":
            message = f"a space is missing behind '{word}:'"
            edit = Edit(number, at + 1, 0, " ")
        elif number == line or not match[3].strip():
            message = f"a colon is missing behind '{word}': write '{word}: …'"
            edit = Edit(number, at, 0, ":")
        else:
            continue
        return Spot(source, number, match.start(2) + 1, len(word)), message, [edit]
    text = source.excerpt(line)
    key = _KEY.match(text, len(text) - len(text.lstrip(" -")))
    value = text[key.end() + 1 :].strip() if key is not None else ""
    if key is None or column <= key.end() or ": " not in value or value[0] in "\"'{[":
        return None
    start = text.index(value, key.end()) + 1
    message = f"the value of '{key[1]}' holds a colon: put it in quotes"
    return (
        Spot(source, line, start, len(value)),
        message,
        [Edit(line, start, len(value), f'"{value}"')],
    )


def _item_among_keys(source: Source, line: int) -> _Found | None:
    """Return an item of a list at the column of a mapping's keys."""
    text = source.excerpt(line)
    stands = len(text) - len(text.lstrip()) + 1
    blocks = _open_blocks(source, line)
    if not text[stands - 1 :].startswith("- ") or any(block.is_list for block in blocks):
        return None
    above = next((block for block in blocks if block.column == stands), None)
    if above is None or source.excerpt(_line_before(source, line)).rstrip().endswith(":"):
        return None
    message = f"this list item stands among keys, below '{above.name}': a list belongs under a key of its own"
    return Spot(source, line, stands), message, []


def _misplaced(source: Source, line: int, modifiers: Collection[str]) -> _Found | None:
    """Return a line that stands at a column at which nothing can stand, with the column at which it belongs."""
    text = source.excerpt(line)
    stands = len(text) - len(text.lstrip()) + 1
    is_item = text[stands - 1 :].startswith("- ")
    key = _KEY.match(text, stands - 1)
    blocks = [block for block in _open_blocks(source, line) if block.is_list == is_item]
    if not blocks or not (is_item or key is not None):
        return None
    word = "this item" if key is None else f"'{key[1]}'"
    if key is not None and key[1] in modifiers:
        blocks = [
            block for block in blocks if block.name[:1].isupper() or block.name not in modifiers
        ] or blocks
    nearest = min(abs(block.column - stands) for block in blocks)
    fits = [block for block in reversed(blocks) if abs(block.column - stands) == nearest]
    if nearest == 0:
        return None

    def place(block: _Block) -> str:
        if block.is_list:
            return f"items of {block.name or 'the list'} start at column {block.column}"
        what = "modifiers of" if key is not None and key[1] in modifiers else "keys beside"
        return f"{what} {block.name} start at column {block.column}, under the {block.name[0]}"

    others = "".join(f"; those of {block.name} at column {block.column}" for block in fits[1:])
    message = f"{word} is at column {stands}; {place(fits[0])}{others}"
    edits = [*moved(source, line, fits[0].column - stands)] if len(fits) == 1 else []
    return Spot(source, line, stands, len(key[1]) if key is not None else 1), message, edits


def moved(source: Source, line: int, by: int) -> Iterator[Edit]:
    """Yield the edits that move a line and all that stands in it sideways."""
    first = len(source.excerpt(line)) - len(source.excerpt(line).lstrip())
    for number in range(line, len(source.lines) + 1):
        text = source.excerpt(number)
        indent = len(text) - len(text.lstrip())
        if text.strip() and number > line and indent <= first:
            return
        if text.strip():
            yield Edit(number, 1, indent, " " * max(0, indent + by))


def _open_blocks(source: Source, line: int) -> list[_Block]:
    """Return the lists and mappings of the lines before that may go on in a line, from the outside to the inside."""
    blocks: list[_Block] = []
    brackets = 0
    verbatim = 0
    for text in source.lines[: line - 1]:
        indent = len(text) - len(text.lstrip())
        content = text.strip()
        if not content or content.startswith("#") or (verbatim and indent >= verbatim):
            continue
        verbatim = 0
        inside = brackets > 0
        brackets += sum(_DEEPER.get(match[0], 0) for match in _FLOW.finditer(text))
        if inside:
            continue
        at = indent
        blocks = [block for block in blocks if block.column <= at + 1]
        while text[at : at + 2] == "- ":
            owner = next((block.name for block in reversed(blocks) if not block.is_list), "")
            if not any(block.is_list and block.column == at + 1 for block in blocks):
                blocks.append(_Block(at + 1, True, owner))
            at += 1 + len(text[at + 1 :]) - len(text[at + 1 :].lstrip())
        key = _KEY.match(text, at)
        if key is not None:
            blocks = [
                block
                for block in blocks
                if block.column < at + 1 or (block.is_list and block.column == at + 1)
            ]
            blocks.append(_Block(at + 1, False, key[1].strip("\"'")))
        if _BLOCK_SCALAR.search(text):
            verbatim = indent + 1
    return blocks


def _line_before(source: Source, line: int) -> int:
    """Return the nearest line above that is not empty, or the line itself."""
    return next(
        (number for number in range(line - 1, 0, -1) if source.excerpt(number).strip()), line
    )


def _too_deep_at(text: str) -> tuple[int, int] | None:
    """Return line and column of the first flow bracket below `MAX_DEPTH`, or None.

    libyaml reads ahead of the events that it delivers and refuses 1 000 nested flows itself since PyYAML 6.0.4.
    """
    depth = 0
    for match in _FLOW.finditer(text):
        depth += _DEEPER.get(match[0], 0)
        if depth > MAX_DEPTH:
            line_start = text.rfind("\n", 0, match.start()) + 1
            return text.count("\n", 0, line_start) + 1, match.start() - line_start + 1
    return None


def _tab_at(source: Source, line: int, column: int) -> int:
    """Column of a tab in the line's indentation, at which reading stopped; 0 when there is none."""
    text = source.excerpt(line)
    at = text.find("\t") + 1
    return at if at and not text[: at - 1].strip(" -") and at >= column - 1 else 0
