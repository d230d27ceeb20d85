"""A learnt policy that streams set-points."""
