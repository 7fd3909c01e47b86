"""One target through clutter with an adaptive detection threshold."""
