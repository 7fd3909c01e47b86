"""Parts of the stage that tracks one target in clutter."""
