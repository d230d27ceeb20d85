"""The operator's page: the events of a run, live or recorded, in the browser; the operator's commands back to the runner."""
