"""The kind of each find in a photograph: a finder of round fruit becomes one of apples, oranges or tomatoes."""
