"""The browser gateway: serves the teaching page and acts on the bus for everybody who has it open."""
