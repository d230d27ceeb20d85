"""Unsaved texts outlive their page."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.tools.tree_editor.drafts import MOST_DRAFTS, Draft, Drafts


@pytest.fixture
def drafts(tmp_path: Path) -> Drafts:
    return Drafts(tmp_path / "a.yaml", tmp_path / "cache")


def test_a_page_has_one_draft_and_the_newest_is_first(drafts: Drafts) -> None:
    drafts.keep(Draft("one", "first", "s", 1.0))
    drafts.keep(Draft("two", "other", "s", 2.0))
    drafts.keep(Draft("one", "second", "s", 3.0))
    assert [(draft.page, draft.text) for draft in drafts.all()] == [
        ("one", "second"),
        ("two", "other"),
    ]


def test_a_dropped_draft_is_gone_with_its_folder(drafts: Drafts, tmp_path: Path) -> None:
    drafts.keep(Draft("one", "first", "s", 1.0))
    drafts.drop("one")
    drafts.drop("one")
    assert drafts.all() == []
    assert list((tmp_path / "cache").iterdir()) == []


def test_drafts_of_other_files_stay_apart(drafts: Drafts, tmp_path: Path) -> None:
    drafts.keep(Draft("one", "first", "s", 1.0))
    assert Drafts(tmp_path / "b.yaml", tmp_path / "cache").all() == []


def test_a_draft_that_was_kept_just_now_is_that_of_an_open_page(drafts: Drafts) -> None:
    drafts.keep(Draft("one", "first", "s", 1.0))
    assert drafts.is_open("one", 60.0)


def test_a_damaged_draft_is_left_out(drafts: Drafts, tmp_path: Path) -> None:
    drafts.keep(Draft("one", "first", "s", 1.0))
    (path,) = (tmp_path / "cache").rglob("*.json")
    path.write_text("{")
    assert drafts.all() == []


def test_the_oldest_drafts_are_removed(drafts: Drafts) -> None:
    for number in range(MOST_DRAFTS + 3):
        drafts.keep(Draft(f"page{number}", "text", "s", float(number)))
    assert len(drafts.all()) == MOST_DRAFTS
    assert drafts.all()[-1].page == "page3"


@pytest.mark.parametrize("name", ["", "../../etc", "a/b", "x" * 41])
def test_a_name_that_leads_elsewhere_is_refused(drafts: Drafts, name: str) -> None:
    with pytest.raises(ValueError, match="no name of a page"):
        drafts.keep(Draft(name, "text", "s", 1.0))
