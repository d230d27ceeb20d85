"""Engines: processes on this machine, and a Ray cluster."""
