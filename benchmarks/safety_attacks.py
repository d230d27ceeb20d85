"""Attacks on the whole product: bad input, page, records, state files, processes, and devices at drawn moments.

    python -m benchmarks.safety_attacks [--parts program runs] [--seed 11] [--runs 60] [--out FILE.md]

Each attack has what must hold and what was observed. It fails on a false success, a traceback, an unsafe motion, a lost
record, or a server that no longer answers. The matrix of `make faults` has fixed moments; the runs here draw fault,
moment, duration and an operator's action before it.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.fault_run import branch_cases, prepare_to_fork
from benchmarks.fault_table import Case, CaseVerdict, FaultPhase, read_table
from pomona.drivers.hold_watch import HandMemory, may_hold
from pomona.drivers.interfaces import GripperLimits, GripperState

TREE = """pomona: 1
tree: attacked
root:
  sequence:
    - wait: 100 ms
    - MoveTo: {pose: observe}
"""
WAIT = "pomona: 1\ntree: attacked\nroot:\n  sequence:\n    - wait: 100 ms\n"
MOCK = """name: attacked
kind: mock
workspace: {table_z: 0 m, lower: -1 -1 0 m, upper: 1 1 1 m, poses: {home: 0 0 0 0 0 0 0 rad}}
world: {driver: mock}
devices:
  arm: {driver: mock-arm, start: home}
"""
REAL = "kind: real\ndevices:\n  gripper: {driver: wsg, "
MOMENTS = {
    "MoveTo": 0.6, "Follow": 0.8, "Approach": 1.2, "SlipAvoidGrasp": 0.9, "FeelFriction": 0.6, "Lift": 1.7,
    "Release": 3.0,
}  # fmt: skip
"""Nodes of the pick at which a drawn fault begins, with their durations [s]."""
PROGRAM = (
    sys.executable,
    "-c",
    "import sys; from pomona.executive.cli import main; sys.exit(main())",
)
LIMIT = 120.0
"""Deadline of one process [s]."""


@dataclass(frozen=True, slots=True)
class Attack:
    """One attack and what became of it."""

    area: str
    name: str
    expected: str
    observed: str
    held: bool


# ------------------------------------------------------------------------------------------------- the program


def command(
    *words: str, cwd: Path, stdin: str = "", **more: object
) -> subprocess.CompletedProcess[str]:
    """Run `pomona` with these words; a process that does not end counts as one that was killed."""
    try:
        return subprocess.run(  # type: ignore[call-overload,no-any-return]
            [*PROGRAM, *words],
            cwd=cwd,
            input=stdin,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=LIMIT,
            **more,
        )
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(words, -9, "", f"does not end within {LIMIT:.0f} s")


def refused(
    area: str, name: str, done: subprocess.CompletedProcess[str], status: int = 2
) -> Attack:
    """An attack that must be refused in words."""
    words = f"{done.stdout}\n{done.stderr}"
    last = (done.stderr.strip() or done.stdout.strip() or "nothing").splitlines()[-1][:90]
    held = (
        done.returncode == status
        and "Traceback" not in words
        and "\x1b[" not in words
        and "\u202e" not in words
    )
    return Attack(
        area, name, f"status {status}, in words", f"status {done.returncode}: {last}", held
    )


def input_attacks(folder: Path) -> Iterator[Attack]:
    """Bad words, trees and cells."""
    (folder / "tree.yaml").write_text(TREE)
    (folder / "folder.yaml").mkdir()
    words = {
        "seed of 20 digits": ["--seed", "9" * 20],
        "negative seed": ["--seed=-1"],
        "seed in words": ["--seed", "one"],
        "speed 0 %": ["--speed", "0 %"],
        "speed 1000 %": ["--speed", "1000 %"],
        "speed that is no number": ["--speed", "nan"],
        "unknown setting": ["--set", "speeed=1"],
        "setting without a value": ["--set", "fruit"],
        "setting with control characters": ["--set", "fruit=\x1b[31m\u202e"],
        "setting that is a path": ["--set", "fruit=../../../etc/passwd"],
        "unknown cell": ["--cell", "nowhere"],
        "cell that is a folder": ["--cell", str(folder / "folder.yaml")],
        "cell that is a device": ["--cell", "/dev/zero"],
        "cell that is the tree": ["--cell", str(folder / "tree.yaml")],
        "record below a file": ["--record", str(folder / "tree.yaml" / "runs")],
        "record in /proc": ["--record", "/proc/self/runs"],
        "empty record folder": ["--record", ""],
        "page on a port that does not exist": ["--dashboard", "--port", "99999999"],
        "break before nothing": ["--break-before", "Nowhere", "--dashboard", "--port", "0"],
        "alert to a file": ["--alert-to", "file:///etc/passwd"],
        "recover with a parameter of nothing": ["--recover", "--set", "nothing=1"],
        "unknown option": ["--no-such-option"],
    }
    for name, options in words.items():
        yield refused("words", name, command("run", "tree.yaml", "--quiet", *options, cwd=folder))
    trees = {
        "empty file": "",
        "NUL bytes": "pomona: 1\x00",
        "tab indentation": TREE.replace("    -", "\t-"),
        "tree of version 99": TREE.replace("pomona: 1", "pomona: 99"),
        "two documents": f"{TREE}---\n{TREE}",
        "wait for ever": TREE.replace("100 ms", "inf s"),
        "negative wait": TREE.replace("100 ms", "-1 s"),
        "wait of 1e400 s": TREE.replace("100 ms", "1e400 s"),
        "pose that does not exist": TREE.replace("observe", "observed"),
        "node that does not exist": TREE.replace("MoveTo", "MoveToo"),
        "alias bomb": "a: &a [x,x]\nb: &b [*a,*a]\nc: &c [*b,*b]\nroot: *c\n",
        "cycle of aliases": "pomona: 1\ntree: t\nroot: &r {sequence: [*r]}\n",
        "port of another type": TREE.replace("{pose: observe}", "{pose: 5 mm}"),
        "expression that divides by zero": TREE.replace(
            "- wait: 100 ms", "- wait: 100 ms\n      when: '1 / 0 > 1'"
        ),
        "deep nesting": f"pomona: 1\ntree: t\nroot: {'{sequence: [' * 400}wait: 1 s{']}' * 400}\n",
    }
    for name, text in trees.items():
        (folder / "bad.yaml").write_text(text)
        yield refused("tree", name, command("run", "bad.yaml", "--quiet", cwd=folder))
    yield refused("tree", "named pipe", _with_pipe(folder))
    cells = {
        "simulated cell with a real gripper": "kind: simulated\ndevices:\n  gripper: {driver: wsg, tcp: localhost}\n",
        "heartbeat not finite": f"heartbeat: inf s\n{REAL}tcp: localhost}}\n",
        "address with a newline": f'{REAL}tcp: "a\\nb"}}\n',
        "tcp and can at once": f"{REAL}tcp: a, can: {{channel: can0}}}}\n",
        "gripper that nobody answers": f"{REAL}tcp: 'localhost:1'}}\n",
        "soft limits the wrong way round": f"{REAL}tcp: a, soft_limits: [90 mm, 10 mm]}}\n",
        "driver that does not exist": "kind: real\ndevices:\n  gripper: {driver: wgs}\n",
    }
    for name, text in cells.items():
        (folder / "cell.yaml").write_text(f"name: attacked\n{text}")
        yield refused(
            "cell", name, command("run", "tree.yaml", "--quiet", "--cell", "cell.yaml", cwd=folder)
        )


def _with_pipe(folder: Path) -> subprocess.CompletedProcess[str]:
    os.mkfifo(folder / "pipe.yaml")
    return command("check", "pipe.yaml", cwd=folder)


def replaced(run: Path) -> Path:
    """Remove a file; return its path."""
    run.unlink()
    return run


def record_attacks(folder: Path) -> Iterator[Attack]:
    """Records that were damaged: none may be read as a success."""
    (folder / "tree.yaml").write_text(WAIT)
    (folder / "mock.yaml").write_text(MOCK)
    command("run", "tree.yaml", "--cell", "mock.yaml", "--quiet", "--record", "runs", cwd=folder)
    sound = next((folder / "runs").iterdir())
    content = (sound / "run.mcap").read_bytes()
    middle = len(content) // 2
    mutations: dict[str, Callable[[Path], object]] = {
        "cut to nothing": lambda run: run.write_bytes(b""),
        "cut to 100 bytes": lambda run: run.write_bytes(content[:100]),
        "cut in the middle": lambda run: run.write_bytes(content[:middle]),
        "last byte missing": lambda run: run.write_bytes(content[:-1]),
        "one bit in the middle": lambda run: run.write_bytes(
            content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
        ),
        "one byte near the end": lambda run: run.write_bytes(
            content[:-300] + b"\xff" + content[-299:]
        ),
        "twice one after the other": lambda run: run.write_bytes(2 * content),
        "zeros at the end": lambda run: run.write_bytes(content + bytes(4096)),
        "zeros instead": lambda run: run.write_bytes(bytes(len(content))),
        "a text": lambda run: run.write_text("outcome: success\n"),
        "a folder": lambda run: replaced(run).mkdir(),
        "a pipe": lambda run: os.mkfifo(replaced(run)),
        "a link to /dev/zero": lambda run: replaced(run).symlink_to("/dev/zero"),
        "a link to itself": lambda run: replaced(run).symlink_to(run),
        "missing": replaced,
        "missing, and the summary says success": lambda run: (
            replaced(run).with_name("summary.json").write_text('{"outcome": "success"}')
        ),
    }
    for name, mutate in mutations.items():
        copy = folder / "attacked" / name.replace(" ", "_").replace("/", "_")
        shutil.copytree(sound, copy)
        mutate(copy / "run.mcap")
        done = command("explain", str(copy), cwd=folder)
        words = (done.stdout + done.stderr).strip()
        first = (words or "nothing").splitlines()[0][:90]
        reported = (
            "damaged",
            "cut off",
            "checksum",
            "was whole once",
            "not a record",
            "no record",
            "no such",
            "cannot",
        )
        trusted = "succeeded" in words.partition("\n")[0] and not any(
            word in words for word in reported
        )
        yield Attack(
            "record",
            name,
            "reported, no success",
            f"status {done.returncode}: {first}",
            "Traceback" not in words and not trusted,
        )
    listed = command("runs", "list", "--record", "attacked", cwd=folder)
    yield Attack(
        "record", "list of all damaged records", "status 0, each named", f"status {listed.returncode}",
        listed.returncode == 0 and "Traceback" not in listed.stdout + listed.stderr,
    )  # fmt: skip


def _heed_signals() -> None:
    """A background job of a shell ignores these, and its children inherit that."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGQUIT, signal.SIG_DFL)


def run_attacks(folder: Path) -> Iterator[Attack]:
    """Signals, disks and two processes."""
    (folder / "slow.yaml").write_text(WAIT.replace("100 ms", "30 s"))
    (folder / "tree.yaml").write_text(WAIT)
    (folder / "mock.yaml").write_text(MOCK)

    def started() -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*PROGRAM, "run", "slow.yaml", "--cell", "mock.yaml", "--pace", "real", "--record", "runs"],
            cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
            preexec_fn=_heed_signals,
        )  # fmt: skip
        begun = time.monotonic()
        while time.monotonic() - begun < LIMIT and not list((folder / "runs").glob("*/run.mcap")):
            time.sleep(0.1)
        time.sleep(0.5)
        return process

    ends = {
        "SIGTERM": (signal.SIGTERM, 3), "SIGINT": (signal.SIGINT, 130), "SIGHUP": (signal.SIGHUP, 3),
        "SIGQUIT": (signal.SIGQUIT, -3), "SIGKILL of the parent": (signal.SIGKILL, -9),
    }  # fmt: skip
    for name, (number, status) in ends.items():
        shutil.rmtree(folder / "runs", ignore_errors=True)
        process = started()
        process.send_signal(number)
        said = process.communicate(timeout=LIMIT)[0]
        run = next((folder / "runs").iterdir())
        explained = command("explain", str(run), cwd=folder)
        words = explained.stdout + explained.stderr
        held = (
            process.returncode != 0 and "Traceback" not in said + words and "succeeded" not in words
        )
        yield Attack(
            "end",
            name,
            f"status {status} or 3, record readable",
            f"status {process.returncode}",
            held,
        )
    for size in (0, 4096, 50_000):
        done = command(
            "run", "tree.yaml", "--cell", "mock.yaml", "--record", f"disk_{size}", cwd=folder,
            preexec_fn=lambda limit=size: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        )  # fmt: skip
        words = done.stdout + done.stderr
        held = "Traceback" not in words and (done.returncode != 0 or "record" in words)
        yield Attack(
            "disk", f"files of at most {size} bytes", "reported", f"status {done.returncode}", held
        )
    done = command(
        "run", "tree.yaml", "--cell", "mock.yaml", "--record", "handles", cwd=folder,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (16, 16)),
    )  # fmt: skip
    held = "success" not in done.stdout or done.returncode == 0
    yield Attack(
        "disk", "16 open files", "reported, or a success", f"status {done.returncode}", held
    )
    first = subprocess.Popen(
        [*PROGRAM, "run", "slow.yaml", "--cell", "emulated", "--set", "time=wall", "--record", "shared"],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    begun = time.monotonic()
    while time.monotonic() - begun < LIMIT and not list((folder / "shared").glob("*/run.mcap")):
        time.sleep(0.2)
    second = command(
        "run",
        "tree.yaml",
        "--cell",
        "emulated",
        "--set",
        "time=wall",
        "--record",
        "shared",
        cwd=folder,
    )
    lines = (second.stdout + second.stderr).strip().splitlines()
    yield Attack(
        "two processes", "a second run on an emulated cell of its own world", "refused, or a world of its own",
        f"status {second.returncode}: {lines[-1][:80] if lines else ''}", "Traceback" not in "\n".join(lines),
    )  # fmt: skip
    first.send_signal(signal.SIGTERM)
    status = first.wait(LIMIT)
    yield Attack(
        "two processes", "SIGTERM to the first of them", "status 3", f"status {status}", status == 3
    )


def hand_attacks(folder: Path) -> Iterator[Attack]:
    """Damaged memory of the hand: never an empty hand where something may be held."""
    limits, state = GripperLimits(0.036, 0.102, 0.2, 80.0), GripperState(0.0, 0.08, 0.0, False)
    good = {"format": "pomona hand 1", "held": "", "width": 0.08, "bias": {}}
    texts = {
        "empty file": "",
        "half of it": json.dumps(good)[:20],
        "another format": json.dumps({**good, "format": "pomona hand 2"}),
        "width NaN": json.dumps({**good, "width": float("nan")}),
        "width infinite": json.dumps({**good, "width": float("inf")}),
        "width in words": json.dumps({**good, "width": "wide"}),
        "no width": json.dumps({key: value for key, value in good.items() if key != "width"}),
        "bias NaN": json.dumps({**good, "bias": {"left": [float("nan")]}}),
        "bias that is a list": json.dumps({**good, "bias": [1.0]}),
        "a list": "[]",
        "deep": "[" * 100_000,
        "another width": json.dumps({**good, "width": 0.05}),
        "held": json.dumps({**good, "held": "something is between the fingers"}),
        "binary": "\x00\x01\x02",
    }
    for name, text in texts.items():
        path = folder / "hand.json"
        path.write_text(text)
        try:
            why = may_hold(state, limits, HandMemory(path).record, None)
        except Exception as error:
            yield Attack("hand", name, "may hold something", repr(error)[:80], False)
            continue
        yield Attack("hand", name, "may hold something", why or "empty hand", bool(why))
    path.unlink()
    path.mkdir()
    yield Attack(
        "hand",
        "a folder",
        "may hold something",
        "",
        bool(may_hold(state, limits, HandMemory(path).record, None)),
    )


def page_attacks(folder: Path) -> Iterator[Attack]:
    """Raw requests to the page's server, which must answer a sound one afterwards."""
    (folder / "runs").mkdir(exist_ok=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [*PROGRAM, "dashboard", "--record", "runs", "--port", str(port)],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        begun = time.monotonic()
        while time.monotonic() - begun < LIMIT and not request(
            port, f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n"
        ):
            time.sleep(0.2)
        host = f"Host: localhost:{port}"
        evil, body, deep = (
            "Origin: http://evil.example",
            '{"action": "stop", "viewer": "\\ud800"}',
            "[" * 5000,
        )
        json_type = "Content-Type: application/json"
        upgrade = (
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Version: 13",
            f"Sec-WebSocket-Key: {KEY}",
        )
        raw = {
            "no host": get("/"),
            "foreign host": get("/", "Host: evil.example"),
            "two hosts": get("/", host, "Host: evil.example"),
            "foreign origin": post("{}", host, evil),
            "broken origin": post("{}", host, "Origin: http://["),
            "path traversal": get("/../../etc/passwd", host),
            "encoded traversal": get("/static/%2e%2e/%2e%2e/%2e%2e/etc/passwd", host),
            "NUL in the path": get("/api/runs/%00/record", host),
            "record of a path": get("/api/runs/..%2f..%2fetc%2fpasswd/record", host),
            "image at infinity": get("/api/runs/x/images/inf", host),
            "form post": post("a=b", host, "Content-Type: application/x-www-form-urlencoded"),
            "JSON without a token": post(body, host, json_type),
            "deep JSON": post(deep, host, json_type),
            "length that is negative": f"POST /api/act HTTP/1.1\r\n{host}\r\nContent-Length: -5\r\n\r\n",
            "length and chunks": post("0\r\n\r\n", host, "Transfer-Encoding: chunked"),
            "header of 1 MB": get("/", host, f"X: {'a' * 1_000_000}"),
            "method of nothing": f"STOP /api/act HTTP/1.1\r\n{host}\r\n\r\n",
            "TLS hello": "\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
            "half a request": f"GET / HTTP/1.1\r\n{host}\r\n",
            "websocket of another origin": get("/live", host, evil, *upgrade),
            "websocket of another host": get("/live", "Host: evil.example", *upgrade),
        }
        for name, text in raw.items():
            answer = request(port, text)
            first = answer.splitlines()[0][:60] if answer else "closed"
            leaks = "root:" in answer
            acts = first.startswith("HTTP/1.1 2") and text.startswith("POST")
            sound = request(port, get("/", host))
            held = (
                not leaks
                and not acts
                and " 500 " not in first
                and " 101 " not in first
                and " 200 " in sound[:20]
            )
            yield Attack("page", name, "refused, and the page still answers", first, held)
    finally:
        server.terminate()
        server.communicate(timeout=LIMIT)


KEY = "dGhlIHNhbXBsZSBub25jZQ=="
"""The example of RFC 6455."""


def get(path: str, *headers: str) -> str:
    """A request without a body."""
    return "\r\n".join([f"GET {path} HTTP/1.1", *headers, "", ""])


def post(body: str, *headers: str) -> str:
    """An action with a body."""
    return "\r\n".join(
        ["POST /api/act HTTP/1.1", *headers, f"Content-Length: {len(body)}", "", body]
    )


def request(port: int, text: str) -> str:
    """Send bytes to the page's server, and return the beginning of its answer."""
    try:
        with socket.create_connection(("127.0.0.1", port), 3.0) as link:
            link.settimeout(3.0)
            link.sendall(text.encode("latin-1"))
            return link.recv(4096).decode("latin-1")
    except OSError:
        return ""


# ------------------------------------------------------------------------------------------------------ runs


def drawn_cases(rng: random.Random, count: int) -> list[Case]:
    """Faults at drawn moments of a pick, some of which pass, some with an operator's action before."""
    table = [case for case in read_table("sim") if case.ends != "recovered" and not case.spoils]
    kinds = sorted(
        {(c.switch, c.kind) for c in table if c.phase.name != "preparing" and not c.phase.operator}
    )
    drawn = []
    for index in range(count):
        switch, kind = rng.choice(kinds)
        node = rng.choice(list(MOMENTS))
        operator = rng.choice(["", "", "", "pauses", "stops"])
        # An operator acts 0.25 s after the node's start; a stopped run ends soon after.
        first, last = {
            "": (0.0, MOMENTS[node]),
            "pauses": (0.3, MOMENTS[node]),
            "stops": (0.26, 0.32),
        }[operator]
        after = rng.uniform(first, max(first, last))
        lasts = rng.choice([float("inf"), rng.uniform(0.02, 0.6)])
        phase = FaultPhase(f"{index}", node, round(after, 3), operator)
        drawn.append(Case(switch, kind, phase, "harmless", float("inf"), lasts=round(lasts, 3)))
    return drawn


def drawn_runs(seed: int, count: int, jobs: int) -> list[Attack]:
    """Run the drawn cases on the simulated cell."""
    found: list[Attack] = []

    def tell(verdict: CaseVerdict) -> None:
        case = verdict.case
        moment = f"{case.phase.node} + {case.phase.after:.2f} s"
        name = f"{case.name} at {moment}" + (
            f", after the operator {case.phase.operator}" if case.phase.operator else ""
        )
        seen = "; ".join(verdict.wrong) or f"{verdict.outcome} {verdict.reason[:60]}".strip()
        found.append(
            Attack("run", name, "no false success, drop, opening or force", seen, not verdict.wrong)
        )
        print("✗" if verdict.wrong else "✓", name, seen, file=sys.stderr, flush=True)

    prepare_to_fork()
    branch_cases(drawn_cases(random.Random(seed), count), "sim", seed, jobs, tell)
    return found


# ---------------------------------------------------------------------------------------------------- report


def report(attacks: Sequence[Attack], commands: str) -> str:
    """Write the attacks as a table."""
    failed = sum(not attack.held for attack in attacks)
    lines = [
        "# Attacks with fresh eyes", "",
        f"{len(attacks)} attacks, {failed} failed. `{commands}`, on the simulated cell and this computer.", "",
        "| area | attack | expected | observed | held |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for attack in attacks:
        cells = (
            attack.area,
            attack.name,
            attack.expected,
            attack.observed,
            "yes" if attack.held else "**no**",
        )
        clean = [
            "".join(c if c.isprintable() else "·" for c in cell).replace("|", "/") for cell in cells
        ]
        lines.append(f"| {' | '.join(clean)} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--parts", nargs="*", default=["program", "runs"], choices=("program", "runs")
    )
    parser.add_argument("--only", nargs="*", help="areas of the program")
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    found: list[Attack] = []
    if "program" in options.parts:
        for attack in (hand_attacks, input_attacks, record_attacks, page_attacks, run_attacks):
            if options.only and attack.__name__.removesuffix("_attacks") not in options.only:
                continue
            with tempfile.TemporaryDirectory() as folder:
                for one in attack(Path(folder)):
                    found.append(one)
                    print(
                        "✓" if one.held else "✗",
                        one.area,
                        "·",
                        one.name,
                        "·",
                        one.observed,
                        file=sys.stderr,
                        flush=True,
                    )
    if "runs" in options.parts:
        found += drawn_runs(options.seed, options.runs, options.jobs)
    text = report(
        found, f"python -m benchmarks.safety_attacks --seed {options.seed} --runs {options.runs}"
    )
    if options.out is not None:
        options.out.write_text(text, encoding="utf-8")
    print(text.splitlines()[2])
    return 1 if any(not attack.held for attack in found) else 0


if __name__ == "__main__":
    sys.exit(main())
