"""Measured logs: how each is read, how verbs are run on them, and what is required of the results."""
