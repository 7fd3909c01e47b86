"""Optional pictures: one function per container, takes an axis, returns it."""
