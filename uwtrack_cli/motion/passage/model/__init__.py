"""What a sensor receives from a vessel that passes: law, unknowns, measurements."""
