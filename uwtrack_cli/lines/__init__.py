"""Peaks to harmonic families and frequency lines."""
