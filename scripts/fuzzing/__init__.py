"""Hostile inputs for every reader and every option, and kills at every moment: seeded, each case repeatable alone."""
