"""Closed forms: geometry, retarded time, Doppler, propagation, geodesy."""
