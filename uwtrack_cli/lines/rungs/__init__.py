"""Rungs of a ladder: what frames of several lengths have in common."""
