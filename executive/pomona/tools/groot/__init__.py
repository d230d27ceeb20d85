"""Trees of BehaviorTree.CPP and Groot2: import and export of their XML."""
