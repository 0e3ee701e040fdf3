"""The whole system in one thread on virtual time, with seeded faults and one checker a rule (ring 2)."""
