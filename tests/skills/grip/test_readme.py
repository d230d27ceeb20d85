"""The grip's README follows one wrench sample: it passes through the files of the table, and all names exist."""

from __future__ import annotations

from pathlib import Path

from benchmarks.grasp_patch import Fruit
from benchmarks.grasp_trial import Lifting, run_trial
from pomona.skills import grip
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.grip import GripPhase
from pomona.skills.grip.settings import GripSettings
from tests.skills.walk import files_named, files_visited, names_defined, steps_of

FOLDER = Path(grip.__file__).parent
PAGE = (FOLDER / "README.md").read_text("utf-8")


def test_samples_of_a_held_fruit_pass_through_the_files_of_the_table(monkeypatch) -> None:
    step, seen = GripController.step, set()

    def followed(self, *sample, **named):
        if self.phase is not GripPhase.HOLDING:
            return step(self, *sample, **named)
        answers = []
        seen.update(files_visited(FOLDER, lambda: answers.append(step(self, *sample, **named))))
        return answers[0]

    monkeypatch.setattr(GripController, "step", followed)
    run_trial(Fruit(), GripSettings(), Lifting(hold=0.2))
    table = steps_of(PAGE, "The steps of `GripController.step`")
    # once in a grip: friction is lowered, and the table of the limit surface made anew
    assert seen - {"limit_surface.py", "settings.py"} == set(table)
    assert len(table) == len(set(table)) == 6


def test_every_file_and_name_exists_and_the_page_is_short() -> None:
    assert len(files_named(PAGE)) > 12
    assert [name for name in files_named(PAGE) if not (FOLDER / name).is_file()] == []
    assert names_defined(FOLDER, PAGE) == set()
    assert len(PAGE.split()) <= 400
