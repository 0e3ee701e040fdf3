"""Teachers: people at a terminal, and scripts that stand in for them."""
