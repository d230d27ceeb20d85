"""The operator's page: a run's events, live or recorded, in the browser; the operator's commands back to the runner."""
