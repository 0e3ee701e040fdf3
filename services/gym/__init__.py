"""Gymnasium on both sides: any discrete environment as a session's world, and Sokoban as an environment.

Gymnasium is an extra: importing this package does not import it.
"""
