"""What editors ask about tree files: findings, completion, hover, definitions, renaming."""
