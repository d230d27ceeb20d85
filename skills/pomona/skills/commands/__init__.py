"""Subcommands that come with the skills."""
