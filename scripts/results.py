"""Write docs/results.md, the table of what was measured, from docs/results.json.

    python scripts/results.py

Each row of the JSON list is one claim: `id`, `subject`, `claim`, `figure` with units, the `command` that measures it,
and `commit` (measured there) or `recorded` (the commit that wrote the figure down). Where they are known it has `interval`
(95 %), `cases`, `seeds`, `measured` (date or processor), `judge` (what decided) and `note`.
"""

from __future__ import annotations

import json
from itertools import groupby
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1] / "docs"
ROWS = DOCS / "results.json"
PAGE = DOCS / "results.md"

EARLIER = "95ed5b87"
"""The last commit with docs/evidence and docs/reports."""

HEAD = f"""# Results

All of this is simulation, but for the rows judged by photographs or calipers, and at mixed commits; release 0.2 measures
it anew. `make results` writes this page from [results.json](results.json). Intervals are 95 %. `at` a commit: measured
there; `by` a commit: written down there. The earlier prose with all tables and attempts: commit `{EARLIER}`, docs/evidence
and docs/reports.
"""


def read_rows() -> list[dict[str, str]]:
    """Return all rows."""
    rows: list[dict[str, str]] = json.loads(ROWS.read_text("utf-8"))
    return rows


def line(row: dict[str, str]) -> str:
    """Return a row as a line of the page's table; its id is an anchor."""
    figure = f"**{row['figure']}**"
    if "interval" in row:
        figure += f" ({row['interval']})"
    seeds = f"seeds {row['seeds']}" if "seeds" in row else ""
    of = [row.get("cases", ""), seeds, row.get("judge", ""), row.get("note", "")]
    made = f"at `{row['commit']}`" if "commit" in row else f"by `{row['recorded']}`"
    if "measured" in row:
        made += f", {row['measured']}"
    cells = [
        f"<span id='{row['id']}'></span>{row['claim']}",
        figure,
        "; ".join(part for part in of if part),
        f"`{row['command']}` {made}",
    ]
    return f"| {' | '.join(cells)} |"


def page(rows: list[dict[str, str]]) -> str:
    """Return the whole page: one table for each subject."""
    parts = [HEAD]
    for subject, group in groupby(rows, key=lambda row: row["subject"]):
        lines = "\n".join(line(row) for row in group)
        parts.append(
            f"## {subject}\n\n| claim | figure | of | measured |\n|---|---|---|---|\n{lines}\n"
        )
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(read_rows()), encoding="utf-8")
