"""One language for every file: YAML with places, findings, shapes of files."""
