"""Skills, drivers and words of trees for Pomona."""
