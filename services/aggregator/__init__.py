"""The aggregator: a teacher to the learner, and to its crowd what a learner is to its teachers."""
