"""Services for editors of tree files: findings, completion, hover, definitions, renaming."""
