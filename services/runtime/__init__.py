"""What every service runs on: the bus, the clock, the loop, the journal file."""
