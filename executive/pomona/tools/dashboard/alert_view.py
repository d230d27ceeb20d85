"""Alerts as a view of `pomona run`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from pomona.executive.run_views import RunView, ViewedRun
from pomona.executive.running.events import Event
from pomona.tools.dashboard.alert_options import add_alerts, alerts_of, outcomes_in

if TYPE_CHECKING:
    from pomona.tools.dashboard.alerts import Alerts


class AlertView(RunView):
    """Alerts when the success rate of runs is too low."""

    _alerts: Alerts

    def add(self, parser: argparse.ArgumentParser) -> None:
        add_alerts(parser)

    def open(self, options: argparse.Namespace, run: ViewedRun) -> bool:
        if options.alert_to is None:
            return False
        alerts = alerts_of(options, outcomes_in(options.record, options.alert_over))
        assert alerts is not None
        self._alerts = alerts
        return True

    def on_event(self, event: Event) -> None:
        self._alerts.on_event(event)

    def close(self) -> None:
        self._alerts.wait()
