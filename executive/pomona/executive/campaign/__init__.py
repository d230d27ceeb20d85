"""Many runs: what varies, in a file; local processes; results that survive a kill; a report."""
