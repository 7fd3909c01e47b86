"""How a closest approach is fitted to frequencies, bearings and levels."""
