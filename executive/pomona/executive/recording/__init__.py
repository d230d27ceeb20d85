"""Events to a record, and a record back to events."""
