"""How one target is followed through clutter, and where to set its threshold."""
