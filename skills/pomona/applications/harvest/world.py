"""The fruit wall in time: wind blows, stems break, and the score watches."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pomona.applications.harvest.model import WallModel
from pomona.applications.harvest.reachable import find_reachable
from pomona.applications.harvest.score import WallScore
from pomona.applications.harvest.stems import Stems
from pomona.applications.harvest.wind import Wind
from pomona.executive import Float64
from pomona.tools.simulation import PhysicsWorld

SETTLING = 50  # steps for the arm's drives to take up their load; the wall is drawn at rest
WIND_EVERY = 5  # steps between two values of the wind: it changes at 1.5 Hz at most


class FruitWallWorld(PhysicsWorld):
    """A robot before a fruit wall."""

    def __init__(
        self, built: WallModel, description: Path, q_start: Float64, seed: int, wind: float = 0.0
    ) -> None:
        super().__init__(built.model, description, q_start, seed)
        self.built = built
        self.stems = Stems(built, self.state)
        self.wind = Wind(built, self.state, wind)
        self.score = WallScore(built, self.state, self.stems)
        self._reachable: tuple[bool, ...] | None = None
        self.before_step.append(self._blow)
        self.after_step.append(self._break)

    def truth(self) -> Mapping[str, object]:
        """Return the wall's own score; see `score.WallScore.report`. The reachable fruit are determined once."""
        if self._reachable is None:
            self._reachable = find_reachable(self.built, self.description)
        return self.score.report(self._reachable)

    def looked(self) -> None:
        """A camera looks now: remember where the fruit truly hang."""
        self.score.note_look()

    def watch(self) -> None:
        self.score.look_at_wood()

    def _settle(self) -> None:
        for _ in range(SETTLING):
            self.mujoco.mj_step(self.model, self.state)
        self.state.time = 0.0

    def _blow(self) -> None:
        if self.clock.steps % WIND_EVERY == 0:
            self.wind.blow(self.clock.now())

    def _break(self) -> None:
        self.score.look(self.stems.look())
