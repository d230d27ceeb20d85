"""Subcommands of `pomona` that concern devices: doctor, calibrate, emulate."""
