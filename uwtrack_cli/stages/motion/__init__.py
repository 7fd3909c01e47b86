"""Parts of the target-motion stage."""
