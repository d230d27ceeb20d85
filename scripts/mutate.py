"""Make one small mistake at a time in the core, and count how many of them the quick tests find.

    python scripts/mutate.py --map                 # which test reaches which line; again after a change, or to go on
    python scripts/mutate.py --most 200 --seed 1   # the share that is found, and the places of the others

The map is kept in pieces, one for each file of tests. A piece is made again when a file has changed whose lines its
tests have run. `--map --seconds 280` ends after that time; the next call goes on.

A place is drawn from all places of the core, each as likely as any other, and gets one of its mistakes at random. The
quick tests that reach its line run in a process of their own; for a place in a kernel, or in a constant of a module
with kernels, these are not compiled. The mistake is found when one of the tests fails or does not end. A place that no
quick test reaches counts as not found.

Mistakes: another operator, the neighbouring or the opposite comparison, `and` for `or`, a negated condition, the other
boolean, another number, min for max, two arguments of a call swapped, a statement left out (a call without a result, an
assignment to an attribute), None for a result.

By rule, no mistakes are made where none shows in a result: strings and f-strings, expressions that are raised or
asserted, log lines, `__repr__` and `__str__`, annotations, decorators, `if TYPE_CHECKING`, equal arguments, and
arguments of symmetric functions (`SYMMETRIC`).
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import hashlib
import importlib
import json
import marshal
import os
import random
import re
import resource
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import accumulate, islice
from pathlib import Path
from types import CodeType
from typing import Any

import coverage
import pytest

ROOT = Path(__file__).resolve().parents[1]
CORE = ("executive/pomona/executive", "skills/pomona/skills", "drivers/pomona/drivers")
TESTS = ("tests/executive", "tests/skills", "tests/drivers")
UNCOMPILED = ("tests/skills",)
LEAVES = ("tools", "devices", "applications")
MAP = ROOT / "runs" / "mutate"
KERNEL = re.compile(r"\b(?:kernel|njit)\(")
TRACED = 3.0
"""Processor time of a quick test whose lines are traced and whose kernels may not be compiled [s]."""
WAITING = 30.0
"""Time of a test whose lines are traced [s]: what a limit interrupts may leave a lock behind."""
AGAIN = 2.0
"""Time from one interruption of a test to the next [s]: code that a library calls back may swallow the first."""
PIECE = 240.0
"""Time of a piece of the map, which has no tests if it takes longer [s]."""
BUDGET = 40.0
"""Processor time of the tests of one mistake, as the map has it [s]."""
MEMORY = 16 << 30
"""Address space of a process with a mistake [bytes]."""

OTHERS = {
    "Add": "Sub",
    "Sub": "Add",
    "Mult": "Div",
    "Div": "Mult",
    "Pow": "Mult",
    "FloorDiv": "Mult",
    "Mod": "Mult",
    "And": "Or",
    "Or": "And",
    "Lt": "LtE GtE",
    "LtE": "Lt Gt",
    "Gt": "GtE LtE",
    "GtE": "Gt Lt",
    "Eq": "NotEq",
    "NotEq": "Eq",
    "In": "NotIn",
    "NotIn": "In",
    "Is": "IsNot",
    "IsNot": "Is",
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "any": "all",
    "all": "any",
}
"""Operators, as `ast` names them, and names of functions, each with those that stand for it by mistake."""
SYMMETRIC = (
    "min",
    "max",
    "minimum",
    "maximum",
    "hypot",
    "isclose",
    "allclose",
    "array_equal",
    "_dot",
    "math.dist",
)
LOG_LINE = re.compile(r"(\w+\.)*_?(logger|log|getLogger\(.*\))\.\w+\(", re.IGNORECASE)
WITHOUT_RESULT = (ast.Raise, ast.Assert, ast.JoinedStr)
FIELDS_WITHOUT_RESULT = ("annotation", "returns", "decorator_list")


@dataclass(frozen=True)
class Place:
    """A node that can be mistaken, with the lines that a test must reach, or the name whose use is as good."""

    path: Path
    node: ast.AST
    mistakes: tuple[ast.AST, ...]
    lines: range
    name: str
    in_kernel: bool


def others(value: object) -> list[Any]:
    """Return what can stand for an operator or a name by mistake."""
    if isinstance(value, ast.AST):
        return [getattr(ast, name)() for name in others(type(value).__name__)]
    return OTHERS.get(str(value), "").split()


def mistakes(node: ast.AST, is_condition: bool) -> Iterator[ast.AST]:
    """Yield all nodes that can stand for a node by mistake."""
    for field in ("op", "attr", "id"):
        for other in others(getattr(node, field, None)):
            new = copy.copy(node)
            setattr(new, field, other)
            yield new
    match node:
        case ast.Compare(left, [first, *rest], values):
            for other in others(first):
                yield ast.Compare(left, [other, *rest], values)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            yield operand
        case ast.Constant(bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(int(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(float(value)):
            yield ast.Constant(2.0 * value or 1.0)
        case ast.Call(function, [first, second, *rest], keywords):
            texts = {ast.unparse(first), ast.unparse(second)}
            is_symmetric = ast.unparse(function).endswith(SYMMETRIC)
            if len(texts) == 2 and not is_symmetric and not "".join(texts).count("*"):
                yield ast.Call(function, [second, first, *rest], keywords)
        case ast.Expr(ast.Call()) | ast.Assign([ast.Attribute()]) | ast.AugAssign(ast.Attribute()):
            yield ast.Pass()
        case ast.Return(ast.expr() as value) if ast.unparse(value) != "None":
            yield ast.Return(ast.Constant(None))
    if is_condition and isinstance(node, (ast.Name, ast.Attribute, ast.Call)):
        yield ast.UnaryOp(ast.Not(), node)


def shows(node: ast.AST) -> bool:
    """Return False where no mistake shows in a result."""
    match node:
        case ast.FunctionDef(name="__repr__" | "__str__") | ast.If(ast.Name("TYPE_CHECKING")):
            return False
        case ast.Expr(value):
            return not LOG_LINE.match(ast.unparse(value))
        case ast.Subscript(ast.Name("Annotated")):  # an annotation with a name
            return False
    return not isinstance(node, WITHOUT_RESULT)


def places(path: Path, tree: ast.AST) -> list[Place]:
    """Return all places of a module."""
    found: list[Place] = []

    def look(
        node: ast.AST, lines: range, name: str, is_condition: bool, in_kernel: bool = False
    ) -> None:
        if not shows(node):
            return
        if isinstance(node, ast.stmt) and lines:
            lines = header(node)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            name = next(part.id for part in ast.walk(node) if isinstance(part, ast.Name))
        made = tuple(mistakes(node, is_condition))
        if made:
            found.append(Place(path, node, made, lines, name, in_kernel or not lines))
        if isinstance(node, ast.FunctionDef):
            decorators = map(ast.unparse, node.decorator_list)
            in_kernel = in_kernel or any(map(KERNEL.search, decorators))
            lines = range(node.body[0].lineno, (node.end_lineno or 0) + 1)
        is_compound = is_condition and isinstance(node, (ast.BoolOp, ast.UnaryOp))
        for field, value in ast.iter_fields(node):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and field not in FIELDS_WITHOUT_RESULT:
                    is_test = is_compound or field in ("test", "ifs")
                    look(child, lines, name, is_test, in_kernel)

    look(tree, range(0), "", False)
    has_kernels = KERNEL.search(ast.unparse(tree)) is not None
    return [replace(place, in_kernel=place.in_kernel and has_kernels) for place in found]


def header(statement: ast.stmt) -> range:
    """Return the lines of a statement without those of the statements in it."""
    body = getattr(statement, "body", None)
    end = body[0].lineno if body else (statement.end_lineno or 0) + 1
    return range(statement.lineno, max(end, statement.lineno + 1))


class Put(ast.NodeTransformer):
    """Puts a node where another one stands."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self.old = old
        self.new = ast.fix_missing_locations(ast.copy_location(new, old))

    def visit(self, node: ast.AST) -> ast.AST:
        return self.new if node is self.old else self.generic_visit(node)


SITE = """
import os

if os.environ.get("MUTATE_CODE"):
    import marshal
    from importlib.machinery import SourceFileLoader

    with open(os.environ["MUTATE_CODE"], "rb") as file:
        path, code = marshal.load(file)
    read = SourceFileLoader.get_code
    SourceFileLoader.get_code = lambda self, name: code if self.path == path else read(self, name)
elif os.environ.get("COVERAGE_PROCESS_START"):
    import coverage

    coverage.process_startup()
"""
"""Start of the processes that tests start: they have the mistake, too, and their lines count."""


def import_changed(path: Path, code: CodeType) -> None:
    """Import one module of this process and of those that it starts from other code."""
    changed = MAP / "changed"
    changed.write_bytes(marshal.dumps((str(path), code)))
    os.environ["MUTATE_CODE"] = str(changed)
    prepare_processes()
    exec(SITE, {})


def prepare_processes() -> None:
    """Let the processes that this one starts begin with `SITE`."""
    (MAP / "site").mkdir(parents=True, exist_ok=True)
    (MAP / "site" / "sitecustomize.py").write_text(SITE, encoding="utf-8")
    paths = [str(MAP / "site"), os.environ.get("PYTHONPATH", "")]
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, paths))


class Watch:
    """Plugin of pytest that ends tests at a limit, and measures their processor time.

    Attributes:
        limits: the tests to run, in their order, each with its limit [s]; all tests with `TRACED` if it is empty.
        seconds: processor time of the tests that passed.
    """

    def __init__(self, limits: dict[str, float]) -> None:
        self.limits = limits
        self.seconds: dict[str, float] = {}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self.limits:
            order = list(self.limits)
            items[:] = [item for item in items if item.nodeid in self.limits]
            items.sort(key=lambda item: order.index(item.nodeid))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, None, None]:
        os.environ["MUTATE_TEST"] = f"{item.nodeid}|run"
        signal.signal(signal.SIGPROF, lambda *_: pytest.fail("takes too long"))
        if not self.limits:
            signal.signal(signal.SIGALRM, lambda *_: pytest.fail("waits too long"))
            signal.setitimer(signal.ITIMER_REAL, WAITING, AGAIN)
        signal.setitimer(signal.ITIMER_PROF, self.limits.get(item.nodeid, TRACED), AGAIN)
        began = sum(os.times()[:4])
        try:
            yield
            self.seconds[item.nodeid] = sum(os.times()[:4]) - began
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            if not self.limits:
                signal.setitimer(signal.ITIMER_REAL, 0.0)


def file_of(test: str) -> str:
    """Return the file of a test."""
    return test.partition("::")[0]


def run_tests(paths: Sequence[str], watch: Watch, *options: str) -> int:
    """Run quick tests here; return pytest's exit status."""
    without = [f"-pno:{name}" for name in ("xdist", "cacheprovider", "randomly", "anyio")]
    without += [f"--ignore-glob=tests/*/{name}" for name in LEAVES]
    loaded_before = "-Wignore::pytest.PytestAssertRewriteWarning"
    quick = "-mnot slow and not long and not realtime and not browser"
    # The place of what a signal has interrupted may have no line, and no traceback.
    found = "--hypothesis-profile=found"
    return pytest.main(
        ["-q", "--tb=no", found, *without, loaded_before, quick, *options, *paths], [watch]
    )


def fork(work: Callable[[], int], limit: float) -> int:
    """Return the exit status of work in a process of its own; negative if it does not end within a limit [s].

    The limit is kept from outside: tests set the timers of their process.
    """
    child = os.fork()
    if child == 0:
        status = 1
        try:
            os.setpgid(0, 0)
            output = os.open(MAP / "tests.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(output, 1)
            os.dup2(output, 2)
            status = work()
        except BaseException:
            sys.excepthook(*sys.exc_info())
        finally:
            os._exit(status)
    end = time.monotonic() + limit
    ended = 0
    while not ended:
        time.sleep(0.02)
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
        ended, status = os.waitpid(child, os.WNOHANG)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # what it has started and left
    return os.waitstatus_to_exitcode(status)


@dataclass(frozen=True)
class Piece:
    """The part of the map that a file of tests makes, with compiled kernels or without."""

    tests: Path
    is_compiled: bool

    @property
    def lines(self) -> Path:
        """Return the file with the lines that the tests reach."""
        name = str(self.tests.relative_to(ROOT)).replace("/", "-")
        return MAP / ("compiled" if self.is_compiled else "uncompiled") / f"{name}.coverage"

    def read(self) -> dict[str, float] | None:
        """Return the processor times of the tests [s], or None if the piece is to be made."""
        with contextlib.suppress(FileNotFoundError):
            seconds, contents = json.loads(self.lines.with_suffix(".json").read_text("utf-8"))
            if all(digest(Path(path)) == content for path, content in contents.items()):
                return dict(seconds)
        return None

    def make(self) -> None:
        """Run the tests in a process of their own, and write which lines they reach."""
        self.lines.parent.mkdir(parents=True, exist_ok=True)
        self.lines.unlink(missing_ok=True)
        if fork(self.trace, PIECE) < 0:
            self.write({}, [])

    def trace(self) -> int:
        """Run the tests here."""
        settings = MAP / "coverage.ini"
        sources = "".join(f"\n    {ROOT / part}" for part in CORE)
        settings.write_text(
            f"[run]\nparallel = true\ncontext = ${{MUTATE_TEST}}\nsource ={sources}\n", "utf-8"
        )
        os.environ["COVERAGE_FILE"] = str(self.lines)
        os.environ["COVERAGE_PROCESS_START"] = str(settings)
        prepare_processes()
        os.environ["NUMBA_DISABLE_JIT"] = str(int(not self.is_compiled))
        importlib.import_module("numba").core.config.reload_config()
        watch = Watch({})
        folders = [f"--cov={ROOT / part}" for part in (*CORE, "tests")]
        options = "--cov-context=test", "--cov-report=", f"--cov-config={os.devnull}"
        run_tests([str(self.tests.relative_to(ROOT))], watch, *folders, *options)
        data = read_lines(self.lines)
        self.write(watch.seconds, [path for path in data.measured_files() if data.lines(path)])
        return 0

    def write(self, seconds: dict[str, float], ran: Iterable[str]) -> None:
        """Write the times of the tests, and the files that they have run."""
        contents = {path: digest(Path(path)) for path in (*ran, str(self.tests))}
        text = json.dumps([seconds, contents])
        self.lines.with_suffix(".json").write_text(text, encoding="utf-8")


def read_lines(path: Path) -> coverage.CoverageData:
    """Read a file of reached lines."""
    data = coverage.CoverageData(str(path))
    data.read()
    return data


@cache
def digest(path: Path) -> str:
    """Return a hash of a file, empty if there is none."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def pieces(is_compiled: bool) -> list[Piece]:
    """Return the pieces of the map; those without compiled kernels are of skills, which alone have kernels."""
    folders = TESTS if is_compiled else UNCOMPILED
    found = sorted(path for part in folders for path in (ROOT / part).rglob("test_*.py"))
    return [Piece(path, is_compiled) for path in found if not set(LEAVES) & set(path.parts)]


class Reached:
    """The map: the tests that reach a place of a module, with compiled kernels or without."""

    def __init__(self, is_compiled: bool) -> None:
        self.is_compiled = is_compiled
        self.seconds: dict[str, float] = {}
        data = coverage.CoverageData(no_disk=True)
        for piece in pieces(is_compiled):
            seconds = piece.read()
            if seconds is None:
                raise SystemExit(f"not in the map: {piece.tests}\nmake mutate-map")
            if seconds:
                self.seconds.update(seconds)
                data.update(read_lines(piece.lines))
        self.contexts = cache(data.contexts_by_lineno)
        self.texts = {path: path.read_text("utf-8").splitlines() for path in modules()}

    def tests(self, place: Place) -> list[str]:
        """Return tests that reach a place, those of its module and the fastest first, within `BUDGET`."""
        contexts = {
            context.rpartition("|")
            for path, line in self.lines(place)
            for context in self.contexts(str(path)).get(line, ())
        }
        # What is set up once serves all tests of the file.
        reached = {test if phase == "run" else file_of(test) for test, _, phase in contexts}
        found = [test for test in self.seconds if not reached.isdisjoint((test, file_of(test)))]
        own = f"/test_{place.path.stem}.py"
        found.sort(key=lambda test: (own not in test, self.seconds[test]))
        spent = accumulate(self.seconds[test] for test in found)
        return [test for test, seconds in zip(found, spent, strict=True) if seconds < BUDGET]

    def lines(self, place: Place) -> Iterator[tuple[Path, int]]:
        """Yield the lines that reach a place: its own, or outside of functions those that use its name."""
        if place.lines:
            yield from ((place.path, line) for line in place.lines)
            return
        used = re.compile(rf"\b{place.name}\b")
        for path in self.texts if place.name else [place.path]:
            for number, text in enumerate(self.texts[path], start=1):
                if used.search(text):
                    yield path, number

    def finds(self, place: Place, code: CodeType) -> bool:
        """Return True if a test finds a mistake."""
        tests = self.tests(place)
        for some in (tests[:20], tests[20:]):
            limits = {test: 5.0 + 10.0 * self.seconds[test] for test in some}

            def mistaken(limits: dict[str, float] = limits) -> int:
                resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
                os.environ["NUMBA_DISABLE_JIT"] = str(int(not self.is_compiled))
                importlib.import_module("numba").core.config.reload_config()
                import_changed(place.path, code)
                files = sorted({file_of(test) for test in limits})
                return run_tests(files, Watch(limits), "-x")

            longest = 60.0 + 20.0 * sum(self.seconds[test] for test in some)
            if some and fork(mistaken, longest) not in (0, 5):
                return True
        return False


def modules() -> list[Path]:
    """Return the modules of the core."""
    return sorted(path for part in CORE for path in (ROOT / part).rglob("*.py"))


def draw(most: int, seed: int) -> Iterator[tuple[Place, ast.AST, CodeType]]:
    """Yield places of the core, each with a mistake and the code of its module with it."""
    trees = {path: ast.parse(path.read_text("utf-8")) for path in modules()}
    found = [place for path, tree in trees.items() for place in places(path, tree)]
    chance = random.Random(seed)
    for place in chance.sample(found, min(most, len(found))):
        new = chance.choice(place.mistakes)
        wrong: Any = Put(place.node, new).visit(trees[place.path])
        yield place, new, compile(wrong, str(place.path), "exec")
        Put(new, place.node).visit(trees[place.path])


def score(maps: Sequence[Reached], first: int, most: int, seed: int) -> None:
    """Print which mistakes after the first ones are not found, and how many are, by package."""
    tried: Counter[str] = Counter()
    found: Counter[str] = Counter()
    for place, new, code in islice(draw(most, seed), first, None):
        path = place.path.relative_to(ROOT)
        reached = maps[not place.in_kernel]
        packages = ("all", path.parts[2], "/".join(path.parts[2:4]))
        tried.update(packages)
        if reached.finds(place, code):
            found.update(packages)
            continue
        was = ast.unparse(place.node).partition("\n")[0]
        mark = "" if reached.tests(place) else " (not reached)"
        line = f"{path}:{getattr(place.node, 'lineno', 0)}"
        sys.stdout.write(f"{line}: {was} -> {ast.unparse(new)}{mark}\n")
        sys.stdout.flush()
    for package in sorted(tried):
        share = found[package] / tried[package]
        sys.stdout.write(f"{package:32}{found[package]:4} of {tried[package]:4} {share:6.0%}\n")


def make_map(end: float) -> int:
    """Make the pieces of the map that are missing until a time [s]; return how many are left."""
    MAP.mkdir(parents=True, exist_ok=True)
    missing = [piece for is_compiled in (True, False) for piece in pieces(is_compiled)]
    missing = [piece for piece in missing if piece.read() is None]
    while missing and time.monotonic() < end:
        piece = missing.pop(0)
        began = time.monotonic()
        piece.make()
        took = time.monotonic() - began
        sys.stdout.write(f"{piece.lines.stem} {took:.0f} s, {len(missing)} left\n")
        sys.stdout.flush()
    return min(len(missing), 99)


def main() -> None:
    """Make the map, or try mistakes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--map", action="store_true", help="see which tests reach which lines")
    parser.add_argument("--seconds", type=float, default=3600.0, help="of making the map (3600)")
    parser.add_argument(
        "--first", type=int, default=0, help="mistakes of the draw to leave out (0)"
    )
    parser.add_argument("--most", type=int, default=200, help="mistakes (200)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (1)")
    options = parser.parse_args()
    sys.path[0] = str(ROOT)  # as `python -m pytest` has it
    for module in ("hypothesis.extra.numpy", "numba", "py_trees", "scipy.spatial", "yaml"):
        importlib.import_module(module)  # once, for all processes
    if options.map:
        sys.exit(make_map(time.monotonic() + options.seconds))
    maps = Reached(is_compiled=False), Reached(is_compiled=True)
    score(maps, options.first, options.most, options.seed)


if __name__ == "__main__":
    main()
