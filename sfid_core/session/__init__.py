"""The session machine: events in, state and effects out (`machine.advance`)."""
