"""The learner service: it owns the session machines and their journal, and opens every decision."""
