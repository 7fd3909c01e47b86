"""Lines, levels and bearings to the motion of vessels."""
