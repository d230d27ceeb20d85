"""The library of recorded runs: list, compare, prune, repair, extract, repeat, evidence."""
