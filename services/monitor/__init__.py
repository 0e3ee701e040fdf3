"""The monitor: shows a session live in Rerun and records it; the only package that imports rerun."""
