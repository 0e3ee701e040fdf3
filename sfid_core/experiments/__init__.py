"""Experiments without a wire: batch runs, conditions and statistics."""
