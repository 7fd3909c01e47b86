"""Closed forms on arrays: Doppler, propagation, sound speed, geometry."""
