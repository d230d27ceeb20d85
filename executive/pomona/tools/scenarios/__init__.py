"""Scenario files: a tree with mocks, answers and expected events, run by `pomona test`."""
