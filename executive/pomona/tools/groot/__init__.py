"""Trees of BehaviorTree.CPP, Groot and Nav2: import and export of their XML."""
