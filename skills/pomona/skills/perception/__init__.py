"""From pictures to fruit: models, detection, refinement. No py_trees, no devices."""
