"""What teachers can say, how several of them are merged, and simulated teachers."""
