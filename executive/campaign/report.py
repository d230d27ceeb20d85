"""What a campaign showed: success by what was varied, failures by code, figures with their spread. Markdown."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from executive.campaign.spec import Campaign

Result = Mapping[str, Any]


def wilson(successes: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """95 % interval of a success rate (Wilson's score interval: honest near 0 and 1)."""
    if of == 0:
        return 0.0, 1.0
    p = successes / of
    centre = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of)) / (1 + z * z / of)
    return max(0.0, centre - half), min(1.0, centre + half)


def succeeded(result: Result) -> bool:
    """The tree succeeded and, where there is a simulated world, the world agrees."""
    truth = result.get("truth") or {}
    return result.get("outcome") == "success" and bool(truth.get("lifted", True))


def rate(results: Sequence[Result]) -> str:
    """`24/25 = 96 % (80–99)`."""
    good = sum(map(succeeded, results))
    low, high = wilson(good, len(results))
    return f"{good}/{len(results)} = {100 * good / max(1, len(results)):.0f} % ({100 * low:.0f}–{100 * high:.0f})"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def quantiles(values: Sequence[float]) -> str:
    """`median 1.2 (0.9 … 3.4)`: median, smallest and largest."""
    if not values:
        return "–"
    ordered = sorted(values)
    return f"{ordered[len(ordered) // 2]:.3g} ({ordered[0]:.3g} … {ordered[-1]:.3g})"


FIGURES: Mapping[str, Callable[[Result], Any]] = {
    "robot time [s]": lambda r: r.get("time_s"),
    "computing [s]": lambda r: sum(r.get("compute_s", {}).values()),
    "wall time [s]": lambda r: r.get("wall_s"),
    "peak force [N]": lambda r: (r.get("truth") or {}).get("peak_force_n"),
    "least force [N]": lambda r: (r.get("truth") or {}).get("least_force_n"),
    "slip [mm]": lambda r: (r.get("truth") or {}).get("slip_mm"),
    "attempts": lambda r: max((a["number"] for a in r.get("attempts", []) if a["succeeded"]), default=None),
}


def report(campaign: Campaign, results: Sequence[Result]) -> str:
    """The whole report."""
    parts = [f"# Campaign {campaign.name}", campaign.description, f"{len(results)} of {len(campaign.runs)} runs."]
    by_arm: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        by_arm[result["arm"]].append(result)
    keys = list(campaign.vary)
    for arm, runs in by_arm.items():
        parts.append(f"## {arm}: {rate(runs)}")
        if len(keys) >= 2:
            parts.append(_grid(campaign, runs, keys[0], keys[1]))
        elif keys:
            rows = [[v, rate([r for r in runs if r["varied"][keys[0]] == v])] for v in campaign.vary[keys[0]]]
            parts.append(table([keys[0], "success"], rows))
        parts.append(_figures(runs))
        parts.append(_by_skill(runs))
        parts.append(_failures(runs))
    return "\n\n".join(part for part in parts if part) + "\n"


def _grid(campaign: Campaign, runs: Sequence[Result], row_key: str, column_key: str) -> str:
    columns = campaign.vary[column_key]
    rows = []
    for value in campaign.vary[row_key]:
        of_row = [r for r in runs if r["varied"][row_key] == value]
        cells = [[r for r in of_row if r["varied"][column_key] == column] for column in columns]
        rows.append([value, *(f"{sum(map(succeeded, cell))}/{len(cell)}" for cell in cells), rate(of_row)])
    return table([f"{row_key} \\ {column_key}", *columns, "all"], rows)


def _figures(runs: Sequence[Result]) -> str:
    good = [run for run in runs if succeeded(run)]
    rows = []
    for name, pick in FIGURES.items():
        values = [float(value) for run in good if isinstance(value := pick(run), (int, float))]
        if values:
            rows.append([name, quantiles(values)])
    return table(["figure, successful runs", "median (least … most)"], rows) if rows else ""


def _by_skill(runs: Sequence[Result]) -> str:
    """Time of the robot and of computing, skill by skill."""
    good = [run for run in runs if succeeded(run)]
    names = sorted({name for run in good for kind in ("robot_time_s", "compute_s") for name in run.get(kind, {})})
    rows = []
    for name in names:
        robot, computing = ([run.get(k, {}).get(name, 0.0) for run in good] for k in ("robot_time_s", "compute_s"))
        rows.append([name, quantiles(robot), quantiles(computing)])
    return table(["skill, seconds of a successful run", "robot", "computing"], rows) if rows else ""


def _failures(runs: Sequence[Result]) -> str:
    bad = [run for run in runs if not succeeded(run)]
    if not bad:
        return "No failures."
    codes = Counter(_code(run) for run in bad)
    rows = [
        [code, str(count), next(_message(run) for run in bad if _code(run) == code)]
        for code, count in codes.most_common()
    ]
    return table(["failure", "runs", "for instance"], rows)


def _code(run: Result) -> str:
    reason = run.get("reason")
    return str(reason.get("code")) if reason else "NOT_LIFTED"


def _message(run: Result) -> str:
    reason = run.get("reason")
    text = str(reason.get("message")) if reason else "the tree succeeded, the fruit was not lifted"
    return f"{run['name']}: {text}".replace("|", "/").replace("\n", " ")
