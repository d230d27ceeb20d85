"""The dashboard server: lines of text that switch power and brakes, unlock, stop, and name the robot."""

from __future__ import annotations

from collections.abc import Callable

from pomona.drivers import DeviceFault, DeviceLost, Link
from pomona.executive import Clock

ANSWER = 2.0  # deadline of an answer [s]
GREETING = "Connected"
OLDEST = {3: 12, 5: 6}
"""Oldest minor version of PolyScope by its major version: the first with `get robot model` (dashboard server's list of
commands). `is in remote control` came with 5.6; a CB3 has no such mode."""


class WrongArmError(DeviceFault):
    """The robot at this address is another model than the cell file's."""


class UrDashboard:
    """Asks the dashboard server; each question has a connection of its own."""

    def __init__(self, device: str, open_link: Callable[[], Link], clock: Clock) -> None:
        self._device = device
        self._open = open_link
        self._clock = clock

    def ask(self, command: str) -> str:
        """Send a command and return its answer, a line. Raises DeviceLost: there is none."""
        try:
            link = self._open()
        except OSError as error:
            hint = "is the dashboard server enabled in the pendant's settings, under security and services?"
            raise DeviceLost(
                self._device, f"its dashboard server cannot be reached: {error}; {hint}"
            ) from error
        try:
            return self._answer(link, command)
        except OSError as error:
            raise DeviceLost(self._device, f"its dashboard server failed: {error}") from error
        finally:
            link.close()

    def _answer(self, link: Link, command: str) -> str:
        link.send(command.encode() + b"\n")
        text = b""
        end = self._clock.now() + ANSWER
        while self._clock.now() < end:
            text += link.receive(0.02)
            *whole, _ = text.decode("ascii", "replace").split(
                "\n"
            )  # greeting and answer may come in one chunk
            lines = [line.strip() for line in whole if not line.startswith(GREETING)]
            if lines:
                return lines[0]
        raise TimeoutError(f"no answer to '{command}' within {ANSWER:g} s")

    def require_arm(self, model: str, version: tuple[int, ...]) -> None:
        """Check that the robot is the one of the cell file, and that its software has all that the driver needs.

        Args:
            model: as in the cell file, "ur5e" or "ur5".
            version: of the controller's software.

        Raises DeviceFault, WrongArmError, DeviceLost: it is too old, another one, or does not answer.
        """
        major, minor = version[:2]
        if minor < OLDEST.get(major, minor + 1):
            need = "it needs 3.12 or a later 3, or 5.6 or a later 5"
            raise DeviceFault(
                self._device,
                f"runs PolyScope {major}.{minor}, which this driver does not know: {need}",
            )
        answer = self.ask("get robot model").lower()
        series = "e" if major == 5 and answer in ("ur3", "ur5", "ur10", "ur16") else ""
        if answer + series != model:
            raise WrongArmError(
                self._device, f"is a {answer + series}, not the {model} of the cell file"
            )

    def require_remote_control(self, version: tuple[int, ...]) -> None:
        """Check that the controller accepts programs from outside. Raises DeviceFault: it does not; DeviceLost."""
        if version[0] >= 5 and self.ask("is in remote control").lower() != "true":
            why = "it takes no program from outside"
            raise DeviceFault(
                self._device, f"is in local control, so {why}: switch it to Remote at the pendant"
            )

    def demand(self, command: str, answer: str) -> None:
        """As `ask`, for a command that must be answered by these words. Raises DeviceFault: it was refused."""
        said = self.ask(command)
        if not said.lower().startswith(answer.lower()):
            raise DeviceFault(self._device, f"refuses '{command}': {said}")
