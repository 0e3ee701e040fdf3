"""Sokoban as pure functions: rules, levels, dense state tables, exact solver and episode rules."""
