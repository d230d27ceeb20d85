"""Hover: a skill to begin with."""

from __future__ import annotations

from typing import Annotated

from pomona.executive import LENGTH, TIME, Length, Outputs, Port, Skill, Time, Work


class HoverResult(Outputs):
    """Outputs of Hover."""

    height: Length


class Hover(Skill):
    """Wait a moment, then return the height to reach."""

    failures = ("TOO_HIGH",)

    def run(
        self,
        above: Annotated[Length, Port(min="0 mm", help="on top of the least height")] = LENGTH(
            "5 cm"
        ),
        limit: Length = LENGTH("1 m"),
        settle: Time = TIME("100 ms"),
    ) -> Work[HoverResult]:
        yield "settling"
        yield from self.wait(settle)
        height = LENGTH("10 cm") + above
        if height > limit:
            raise self.failure(
                "TOO_HIGH", f"{height:g} m is above the limit of {limit:g} m", height=height
            )
        return HoverResult(height=height)
