"""Studies with people: from one TOML file to the flow that the page shows, and from its data to a report."""
