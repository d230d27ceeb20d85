"""Alerts: call a webhook when the success rate of runs falls below a limit. A run never waits for it."""

from __future__ import annotations

import argparse
import json
import logging
import re
import threading
import urllib.request
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from http.client import HTTPException
from itertools import islice
from pathlib import Path
from urllib.error import HTTPError
from urllib.parse import urlsplit

from pomona.executive.errors import UsageError
from pomona.executive.recording.index import RunIndex
from pomona.executive.run_views import RunView, ViewedRun
from pomona.executive.running.events import Event, RunEnded, RunStarted
from pomona.executive.values.kinds import Measure
from pomona.executive.values.units import RATIO

logger = logging.getLogger(__name__)

PATIENCE = 5.0  # seconds that the other program may take to answer


@dataclass(frozen=True, slots=True)
class AlertRule:
    """Condition and target of an alert."""

    address: str  # of the webhook, http or https; a JSON object is posted there
    below: float = 0.8  # success rate, 0 to 1, below which an alert is sent
    over: int = 20  # number of the last runs for the rate; no alert before this number is reached

    def __post_init__(self) -> None:
        if problem := _unusable(self.address):
            raise UsageError(f"--alert-to {self.address}: {problem}")
        if not 0.0 < self.below <= 1.0 or self.over < 1:
            raise UsageError(
                "--alert-below takes a share above 0 % and up to 100 %, --alert-over a number of runs from 1"
            )


class Alerts:
    """Counts the outcomes of runs. While the rate is too low, each run's end sends an alert, until one is taken."""

    def __init__(self, rule: AlertRule, before: Iterable[tuple[bool, str]] = ()) -> None:
        """
        Args:
            rule: condition and target of an alert.
            before: earlier runs, oldest first: success of each, and its code if it failed.
        """
        self._rule = rule
        self._outcomes: deque[tuple[bool, str]] = deque(before, maxlen=rule.over)
        self._told = False
        self._run = ""
        self._counted = False
        self._teller: threading.Thread | None = None

    def take(self, event: Event) -> threading.Thread | None:
        """Take an event; return the thread that sends an alert, if there is one to send."""
        if isinstance(event, RunStarted):
            self._run = event.run
            self._counted = False
        if not isinstance(event, RunEnded):
            return None
        if (
            self._counted and self._outcomes
        ):  # it has ended otherwise than it seemed: its record was lost, for instance
            self._outcomes.pop()
        self._counted = bool(self._run)
        leaf = event.reason
        while leaf is not None and leaf.causes:
            leaf = leaf.causes[-1]
        return self.count(event.outcome == "success", "" if leaf is None else leaf.code, self._run)

    def count(self, good: bool, code: str, run: str) -> threading.Thread | None:
        """Count one more run; return the thread that sends an alert, if there is one to send."""
        self._outcomes.append((good, "" if good else code))
        self._told &= self._is_low()
        if self._told or not self._is_low():
            return None
        share = self._share()
        codes = Counter(code for good, code in self._outcomes if not good)
        words = f"{share:.0%} of the last {self._rule.over} runs succeeded, less than {self._rule.below:.0%}"
        most = ", ".join(f"{code or 'no code'} {count}×" for code, count in codes.most_common(3))
        body = {
            "text": f"Pomona: {words}; failures: {most}",
            "success_rate": share,
            "below": self._rule.below,
            "runs": self._rule.over,
            "failures": dict(codes),
            "last_run": run,
        }
        teller = threading.Thread(
            target=self._tell, args=(json.dumps(body).encode(),), name="pomona-alert", daemon=True
        )
        teller.start()
        self._teller = teller
        return teller

    def wait(self) -> None:
        """Give the other program the time it may take, before the process ends."""
        if self._teller is not None:
            self._teller.join(PATIENCE)

    def _share(self) -> float:
        return sum(good for good, _code in self._outcomes) / len(self._outcomes)

    def _is_low(self) -> bool:
        return len(self._outcomes) == self._rule.over and self._share() < self._rule.below

    def _tell(self, body: bytes) -> None:
        asked = urllib.request.Request(
            self._rule.address, body, {"content-type": "application/json"}, method="POST"
        )
        try:
            with _OPENER.open(asked, timeout=PATIENCE):  # http or https: the rule is judged
                self._told = self._is_low()
                return
        except HTTPError as error:
            error.close()  # it holds the connection
            problem: Exception = error
        except (OSError, HTTPException, ValueError) as error:  # the answer may be no HTTP at all
            problem = error
        logger.warning(
            "the alert was not taken by %s: %s; the next run's end sends it again",
            self._rule.address,
            problem,
        )


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """Refuses redirects: an alert goes to the address that was given, and nowhere inside the network behind it."""

    def redirect_request(self, *_arguments: object, **_named: object) -> None:
        """No request: the redirect is an error of the address."""


_OPENER = urllib.request.build_opener(_NoRedirect)


def _unusable(address: str) -> str:
    """Return why an address cannot be used; empty for a usable one."""
    try:
        parts = urlsplit(address)
        usable = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError as error:  # a port that is no number, a bracket that is not closed
        return str(error)
    if not usable:
        return "an address begins with http:// or https://, and names a host"
    return (
        ""
        if address.isascii() and not re.search(r"[\s\x00-\x1f\x7f]", address)
        else "a blank or such a sign is in it"
    )


def outcomes_in(records: Path, most: int) -> list[tuple[bool, str]]:
    """Of the newest recorded runs but those in progress, oldest first: whether each succeeded, and its code if not.

    A run that was killed has no end: it did not succeed.
    """
    ended = (run for run in RunIndex(records).read() if run.state != "running")
    return [(run.outcome == "success", run.code or "") for run in islice(ended, max(most, 0))][::-1]


class AlertView(RunView):
    """Alerts when the success rate of runs is too low."""

    _alerts: Alerts

    def add(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "--alert-to",
            metavar="URL",
            help="post a JSON object to URL when the success rate is below --alert-below",
        )
        parser.add_argument(
            "--alert-below",
            type=Measure(RATIO, low="0 %", high="100 %").option,
            default=0.8,
            metavar="SHARE",
            help="minimum success rate of the last runs (default: 80%%)",
        )
        parser.add_argument(
            "--alert-over",
            type=int,
            default=20,
            metavar="N",
            help="number of last runs for the success rate (default: 20)",
        )

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        if options.alert_to is None:
            return False
        rule = AlertRule(options.alert_to, options.alert_below, options.alert_over)
        self._alerts = Alerts(rule, outcomes_in(options.record, rule.over))
        return True

    def on_event(self, event: Event) -> None:
        self._alerts.take(event)

    def close(self) -> None:
        self._alerts.wait()
