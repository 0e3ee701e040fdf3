"""The pure core of SfID: worlds, learning methods, simulated teachers and the session machine.

Nothing here knows a clock, a thread, a socket, a file (but for packaged levels) or unseeded chance.
"""
