"""Holding the camera still while the platform moves (CONTROL)."""
