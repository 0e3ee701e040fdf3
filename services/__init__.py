"""The shell: everything that touches the world. A service is a loop over one inbox around the pure core."""
