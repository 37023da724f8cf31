"""Other libraries that learn with the planner's help."""
