"""The subcommands of `pomona`, one file each. Other packages add theirs by the entry point group `pomona.commands`."""
