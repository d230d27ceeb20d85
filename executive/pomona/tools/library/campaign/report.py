"""Report of a campaign: success rates, arms compared, figures with their spread, failures by code."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pomona.executive.terminal.words import term
from pomona.tools.library.campaign.document import (
    Bullets,
    Heading,
    Paragraph,
    ReportPage,
    Table,
)
from pomona.tools.library.campaign.run import differs, succeeded
from pomona.tools.library.campaign.spec import Campaign
from pomona.tools.library.campaign.statistics import (
    FEWEST,
    Estimate,
    mean,
    median,
    paired_p,
    wilson,
)

Result = Mapping[str, Any]
Figures = Mapping[str, Callable[[Result], Any]]

RUN_FIGURES: Figures = {
    "robot time [s]": lambda r: r.get("time_s"),
    "computing [s]": lambda r: sum(r.get("compute_s", {}).values()),
    "wall time [s]": lambda r: r.get("wall_s"),
    "attempts": lambda r: max(
        (a["number"] for a in r.get("attempts", []) if a["succeeded"]), default=None
    ),
}


def from_truth(name: str) -> Callable[[Result], Any]:
    """Reads a figure of the simulated world's truth."""
    return lambda result: (result.get("truth") or {}).get(name)


def figures_of(campaign: Campaign) -> Figures:
    """Return the figures that a campaign's report shows, by title."""
    return {**{title(name): from_truth(name) for name in campaign.score.figures}, **RUN_FIGURES}


def title(name: str) -> str:
    """`slip_mm` -> slip [mm]."""
    units = {"mm": "mm", "m": "m", "n": "N", "s": "s", "deg": "°", "kg": "kg", "kpa": "kPa"}
    words, _, unit = name.rpartition("_")
    return f"{term(words)} [{units[unit]}]" if unit in units and words else term(name)


def numbers(results: Sequence[Result], pick: Callable[[Result], Any]) -> list[float]:
    """Return a figure's values, where it is there and a finite number."""
    found = (pick(result) for result in results)
    return [float(v) for v in found if isinstance(v, (int, float)) and math.isfinite(v)]


def percent(rate: float) -> str:
    """`98.7 %`; whole percentages without a decimal."""
    text = f"{100 * rate:.1f}"
    return f"{text.removesuffix('.0')} %"


def rate(results: Sequence[Result]) -> str:
    """`24/25 = 96 % (80–99)`."""
    good = sum(succeeded(result) for result in results)
    low, high = wilson(good, len(results))
    share = percent(good / max(1, len(results)))
    return f"{good}/{len(results)} = {share} ({percent(low)[:-2]}–{percent(high)[:-2]})"


def say(estimate: Estimate, digits: int = 3) -> str:
    """`1.32 (1.2 … 1.4)`."""
    if not estimate.count:
        return "–"
    if estimate.count < FEWEST:
        return f"{estimate.value:.{digits}g}"
    return f"{estimate.value:.{digits}g} ({estimate.low:.{digits}g} … {estimate.high:.{digits}g})"


def commits(results: Sequence[Result]) -> str:
    """Which commits the runs were made at; a + stands for changed files."""
    found = Counter(str(result.get("commit") or "unknown") for result in results)
    if len(found) == 1:
        return f"commit `{next(iter(found))}`"
    return "commits " + ", ".join(
        f"`{commit}` ({count} runs)" for commit, count in found.most_common()
    )


def report(campaign: Campaign, results: Sequence[Result], source: str) -> ReportPage:
    """Return the whole report; `source` is the campaign's file as it was named."""
    document = ReportPage(
        f"Campaign {campaign.name}",
        f"{len(results)} of {len(campaign.runs)} runs, made at {commits(results)} with `pomona campaign {source}`."
        if results
        else "No runs yet.",
    )
    if campaign.description:
        document.add(Paragraph(campaign.description))
    by_arm: dict[str, list[Result]] = {name: [] for name in campaign.arms}
    for result in results:
        by_arm[result["arm"]].append(result)
    by_arm = {name: runs for name, runs in by_arm.items() if runs}
    if not by_arm:
        return document
    document.add(Heading("Success"), overview(campaign, by_arm))
    if len(by_arm) > 1:
        document.add(*comparison(campaign, by_arm))
    document.add(*success_maps(campaign, by_arm))
    document.add(
        Heading("Figures of successful runs"),
        *figures(campaign, by_arm),
    )
    document.add(
        Heading("Time, skill by skill"),
        *(by_skill(campaign, name, runs) for name, runs in by_arm.items()),
    )
    document.add(Heading("Failures"), *failures(campaign, results))
    document.add(
        Paragraph(
            "Rates stand with Wilson's 95 % interval, medians with that of the percentile bootstrap "
            f"(2000 resamples), means with Student's; of fewer than {FEWEST} runs medians and means stand alone.",
            note=True,
        )
    )
    return document


def overview(campaign: Campaign, by_arm: Mapping[str, Sequence[Result]]) -> Table:
    """One line an arm."""
    rows = []
    for name, runs in by_arm.items():
        times = median(numbers(runs, RUN_FIGURES["robot time [s]"]))
        walls = median(numbers(runs, RUN_FIGURES["wall time [s]"]))
        rows.append((name, rate(runs), say(times), say(walls)))
    return Table(("arm", "success", "robot time, median [s]", "wall time, median [s]"), tuple(rows))


def comparison(
    campaign: Campaign, by_arm: Mapping[str, Sequence[Result]]
) -> list[Paragraph | Bullets]:
    """Return each arm beside the first, on the same seeds of the same combinations."""
    first, *others = by_arm
    good = {name: {_place(run): succeeded(run) for run in runs} for name, runs in by_arm.items()}
    lines = []
    for other in others:
        shared = good[first].keys() & good[other].keys()
        only_first = sum(good[first][place] and not good[other][place] for place in shared)
        only_other = sum(good[other][place] and not good[first][place] for place in shared)
        lines.append(
            f"**{first}** beside **{other}** on the same {len(shared)} combinations and seeds: {only_first} succeeded "
            f"only with the first, {only_other} only with the second "
            f"(exact McNemar test, p = {paired_p(only_first, only_other):.2g})"
        )
    return [Bullets(tuple(lines))]


def _place(run: Result) -> tuple[object, ...]:
    return (*sorted(run["varied"].items()), run.get("number"))


def success_maps(campaign: Campaign, by_arm: Mapping[str, Sequence[Result]]) -> list[Table]:
    """Success over the first two things that vary, a table for each arm."""
    keys = list(campaign.vary)
    if not keys:
        return []
    return [_rates(campaign, name, runs, keys) for name, runs in by_arm.items()]


def _rates(campaign: Campaign, name: str, runs: Sequence[Result], keys: Sequence[str]) -> Table:
    columns = campaign.vary[keys[1]] if len(keys) >= 2 else ()
    rows = []
    for value in campaign.vary[keys[0]]:
        of_row = [r for r in runs if r["varied"][keys[0]] == value]
        cells = [[r for r in of_row if r["varied"][keys[1]] == column] for column in columns]
        counts = [
            f"{sum(succeeded(r) for r in cell)}/{len(cell)}" if cell else "–" for cell in cells
        ]
        rows.append((value, *counts, rate(of_row) if of_row else "–"))
    corner = f"{keys[0]} \\ {keys[1]}" if len(keys) >= 2 else keys[0]
    return Table((corner, *columns, "all"), tuple(rows), name)


def figures(campaign: Campaign, by_arm: Mapping[str, Sequence[Result]]) -> list[Table]:
    """Median, mean and extremes of every figure."""
    tables = []
    for arm, runs in by_arm.items():
        rows = []
        for name, pick in figures_of(campaign).items():
            values = numbers(_good(campaign, runs), pick)
            if values:
                extremes = f"{min(values):.3g} … {max(values):.3g}"
                rows.append(
                    (name, say(median(values)), say(mean(values)), extremes, str(len(values)))
                )
        if rows:
            tables.append(
                Table(("figure", "median", "mean", "least … most", "runs"), tuple(rows), arm)
            )
    return tables


def by_skill(campaign: Campaign, arm: str, runs: Sequence[Result]) -> Table:
    """Return the time of the robot and of computing, skill by skill."""
    good = _good(campaign, runs)
    names = sorted(
        {
            name
            for run in good
            for kind in ("robot_time_s", "compute_s")
            for name in run.get(kind, {})
        }
    )
    rows = []
    for name in names:
        robot, computing = (
            [run.get(k, {}).get(name, 0.0) for run in good] for k in ("robot_time_s", "compute_s")
        )
        rows.append((name, say(median(robot)), say(median(computing))))
    return Table(("skill", "robot, median [s]", "computing, median [s]"), tuple(rows), arm)


def failures(campaign: Campaign, results: Sequence[Result]) -> list[Table | Paragraph]:
    """Failures by arm and code, each with an instance and the command that repeats it."""
    orders = {run.name: run.order for run in campaign.runs}
    apart = Counter(words.partition(":")[0] for words in map(differs, results) if words)
    said = ", ".join(f"{number} × {word}" for word, number in apart.items()) or "none"
    beside = Paragraph(f"Runs whose world contradicts the robot's result: {said}.")
    bad = [run for run in results if not succeeded(run)]
    if not bad:
        return [Paragraph("None."), beside]
    rows = []
    for (arm, code), count in Counter((run["arm"], failure_code(run)) for run in bad).most_common():
        example = next(run for run in bad if run["arm"] == arm and failure_code(run) == code)
        rows.append((code, str(count), arm, failure_message(example), _command(example, orders)))
    header = ("code", "runs", "arm", "for instance", "to see it")
    return [Table(header, tuple(rows), words=True), beside]


def failure_code(run: Result) -> str:
    """Return the failure code; FALSE_SUCCESS if only the world denies the success."""
    reason = run.get("reason")
    return str(reason.get("code")) if reason else differs(run).partition(":")[0]


def failure_message(run: Result) -> str:
    """Return the reason as a sentence."""
    reason = run.get("reason")
    return str(reason.get("message")) if reason else differs(run)


def _command(run: Result, orders: Mapping[str, Any]) -> str:
    order = orders.get(run["name"])
    if order is None:
        return str(run["name"])
    settings = "".join(f" --set {key}={value}" for key, value in order.settings.items())
    return f"`pomona run {order.tree.stem} --cell {order.cell.stem} --seed {order.seed}{settings}`"


def _good(campaign: Campaign, runs: Sequence[Result]) -> list[Result]:
    return [run for run in runs if succeeded(run)]
