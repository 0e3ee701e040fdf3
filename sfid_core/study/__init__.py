"""Studies with people: who is in which condition, which step comes next, and what the results say. Pure."""
