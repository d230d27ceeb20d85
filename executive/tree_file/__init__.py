"""Tree files: YAML text → document → findings → py_trees tree."""
