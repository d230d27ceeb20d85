"""A door for assistants: `pomona mcp` serves trees, checks, simulated runs and records of one folder."""
