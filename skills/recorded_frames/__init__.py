"""FirstFrame and NextFrame: go through a folder of recorded frames."""
