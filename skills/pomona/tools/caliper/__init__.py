"""Errors of a cell's calibration, estimated from the touches of ordinary picks."""
