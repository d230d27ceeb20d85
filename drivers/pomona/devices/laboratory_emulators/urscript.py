"""Runs URScript as Python generators: each `next` is one control cycle of the controller.

Covers the statements that drivers' scripts use: functions, threads, `if`, `while`, lists, poses, `global`. The text is
translated line by line to Python, whose syntax tree is then changed: a call that takes time becomes `yield from`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from functools import cache
from types import CodeType
from typing import Any

_TAKE_TIME = "movej movel movep movec servoj servoc speedj speedl stopj stopl sync sleep join_thread stop_wait"
BLOCKING = frozenset(_TAKE_TIME.split())
"""Functions of the controller that take time."""
_LINES = (
    (r"\basync\b", "async_"),
    (r"\bthread\s+(\w+)\s*\(\s*\)\s*:", r"def \1():"),
    (r"\brun\s+(\w+)\(\s*\)", r"run(\1)"),
    (r"\bkill\s+(\w+)", r"kill(\1)"),
    (r"\bjoin\s+(\w+)", r"join_thread(\1)"),
    (r"^(enter_critical|exit_critical)$", "pass"),
    (r"^\s*(global|local)\s+(\w+\s*=)", r"\2"),
    (r"^global\s+\w+$", "pass"),
    (r"^halt$", "halt()"),
)
"""Statements of URScript, and the Python in their place."""


def to_python(text: str) -> str:
    """Return a script as Python with the same functions. Raises SyntaxError: blocks lack their ends."""
    out = []
    depth = 0
    held = ""
    for raw in re.sub(r"(?m)^(\d+)\s+(global .*)$", r"\1\n\2", text).splitlines():
        line = f"{held} {_without_comment(raw).strip()}".strip()
        held = line if line.endswith("=") else ""
        if not line or held:
            continue
        line = _poses(line.replace(" xor ", " ^ "))
        for pattern, becomes in _LINES:
            line = re.sub(pattern, becomes, line)
        if line == "end":
            depth -= 1
        elif re.match(r"(elif|else)\b", line):
            out += ["    " * (depth - 1) + line, "    " * depth + "pass"]
        else:
            out.append("    " * depth + line)
            if re.match(r"(def|if|while)\b", line) and line.endswith(":"):
                depth += 1
                out.append("    " * depth + "pass")
    if depth:
        raise SyntaxError(f"{depth} blocks lack their end")
    return "\n".join(out)


def _without_comment(line: str) -> str:
    parts = line.split('"')
    for place in range(0, len(parts), 2):  # outside of quotation marks
        if "#" in parts[place]:
            return '"'.join([*parts[:place], parts[place].split("#")[0]])
    return line


def _poses(line: str) -> str:
    """Write `p[x, y, …]` as a call; `p[0]` is an index."""
    at = 0
    while found := re.compile(r"(?<!\w)p\[").search(line, at):
        place = found.end()
        depth = 1
        listed = False
        while depth:
            depth += {"[": 1, "]": -1}.get(line[place], 0)
            listed |= depth == 1 and line[place] == ","
            place += 1
        if listed:
            line = f"{line[: found.start()]}pose([{line[found.end() : place - 1]}]){line[place:]}"
        at = found.end()
    return line


class _Weave(ast.NodeTransformer):
    """Makes generators of functions, and `yield from` of calls that take time."""

    def __init__(self, functions: Iterable[str]) -> None:
        self._taking = BLOCKING | set(functions)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id in self._taking:
            return ast.copy_location(ast.YieldFrom(node), node)
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        self.generic_visit(node)
        node.body += ast.parse("if False: yield").body
        return node


def _assigned(nodes: Iterable[ast.AST]) -> set[str]:
    """Return the names that statements assign."""
    targets = (
        t for top in nodes for n in ast.walk(top) if isinstance(n, ast.Assign) for t in n.targets
    )
    return {target.id for target in targets if isinstance(target, ast.Name)}


def compile_script(text: str, functions: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Return a program's name and its globals; `["__main"]()` there gives the program's generator.

    Args:
        functions: of the controller, by their names; those in `BLOCKING` are generators.

    Raises SyntaxError: it is no program.
    """
    name, code = _translated(text)
    space: dict[str, Any] = dict(functions)
    exec(code, space)
    return name, space


@cache
def _translated(text: str) -> tuple[str, CodeType]:
    tree = ast.parse(to_python(text))
    program = tree.body[0]
    if not isinstance(program, ast.FunctionDef):
        raise SyntaxError("a program is `def name(): … end`")
    inner = [node for node in program.body if isinstance(node, ast.FunctionDef)]
    main = [node for node in program.body if not isinstance(node, ast.FunctionDef)]
    _Weave(function.name for function in inner).visit(tree)
    shared = _assigned(
        main
    )  # a function assigns the program's variables where they exist, else its own
    for function in inner:
        own = _assigned(function.body)
        theirs = (own & shared) - {a.arg for a in function.args.args} | {
            n for n in own if n.endswith("_thrd")
        }
        if theirs:
            function.body.insert(0, ast.Global(names=sorted(theirs)))
    entry = ast.parse("def __main():\n    if False: yield").body[0]
    assert isinstance(entry, ast.FunctionDef)
    entry.body = [*([ast.Global(names=sorted(shared))] if shared else []), *main, *entry.body]
    module = ast.fix_missing_locations(ast.Module(body=[*inner, entry], type_ignores=[]))
    return program.name, compile(module, f"<{program.name}>", "exec")
