"""The conveyor: a simulated belt, fruit that is tracked on it, and the skill that picks it while it moves."""
