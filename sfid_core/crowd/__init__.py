"""From many unreliable answers to one: who is believed, how far, and when nothing is said."""
