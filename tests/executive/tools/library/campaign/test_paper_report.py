"""The paper's own arithmetic, and a report that can be made from the first run on."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import paper_numbers as printed
from benchmarks.paper_cells import Cells
from benchmarks.paper_report import paper_report
from pomona.tools.library.campaign.document import to_markdown
from pomona.tools.library.campaign.spec import read_campaign

PAPER = Path(__file__).resolve().parents[5] / "benchmarks" / "paper.yaml"


def test_the_papers_errors_recomputed_from_its_own_tables() -> None:
    dimension = 1e3 * printed.dimension_errors(printed.REFINED_DIMENSIONS)
    assert dimension == pytest.approx([2.8, 10.2, 11.9, 1.4, 8.1], abs=0.05)
    centroid = 1e3 * printed.centroid_errors(printed.REFINED_POSITION)
    assert centroid == pytest.approx([-4.5, 1.5, 5.5, 8.0, 12.5])
    assert printed.REFINED_SUCCESS.mean() == pytest.approx(0.878, abs=1e-3)


def test_the_papers_dimensions_are_mu_times_the_model_that_its_authors_published() -> None:
    scaled = printed.MU_OPT[:, None] * printed.CAD_DEPLOYED
    assert np.abs(scaled - printed.REFINED_DIMENSIONS).max() < 1e-3


def run(arm: str, lifted: bool, position: tuple[float, float, float]) -> dict[str, Any]:
    pose = np.eye(4)
    pose[:3, 3] = (-0.03, -0.52, -0.08)
    return {
        "name": f"{arm}/fruit=apple_1/place=3/seed=2000", "arm": arm, "varied": {"fruit": "apple_1", "place": "3"},
        "number": 0, "commit": "abc1234", "outcome": "success" if lifted else "failure", "attempts": [],
        "reason": None if lifted else {"code": "NO_CANDIDATE", "message": "in the table"},
        "robot_time_s": {"Lift": 1.0}, "compute_s": {"Refine": 0.1}, "time_s": 4.0, "wall_s": 2.0,
        "values": {"measured": {"position_m": position, "dimensions_m": (0.089, 0.08, 0.089), "mu": 0.93}},
        "truth": {
            "lifted": lifted, "T_base_fruit_at_look": pose.tolist(), "dimensions_m": [0.089, 0.081, 0.089],
            "centroid_error_mm": 0.5, "size_error_mm": 1.0, "position_error_mm": 0.7, "width_error_mm": 0.1,
            "largest_press": 0.5, "hold_ratio": 1.2, "hold_force_n": 3.0, "end_ratio": 1.1, "end_force_n": 2.9,
            "slip_mm": 0.1,
        },
    }  # fmt: skip


@pytest.mark.slow
def test_a_report_of_the_first_runs_stands_beside_the_paper() -> None:
    results = [
        run("refined", True, (-0.03, -0.52, -0.079)),
        run("unrefined", False, (-0.03, -0.53, -0.12)),
    ]
    document = paper_report(Cells(read_campaign(PAPER), results), Path("benchmarks/paper.yaml"))
    text = to_markdown(document)
    assert "2 of 150 runs, made at commit `abc1234`" in text
    assert "| Apple 1 | −0.026, −0.525, 0.045 | −0.030, −0.520, 0.041 |" in text
    assert "| 1/1 = 100 % (20.7–100) |" in text
    assert "NO_CANDIDATE" in text
    assert "| Lift | 1 |" in text
    assert not re.search("nan", text)
