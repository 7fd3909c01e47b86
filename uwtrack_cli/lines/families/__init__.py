"""Harmonic families: combs in a frame, and families that last."""
