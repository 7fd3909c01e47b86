"""Several sensors: which encounters are one vessel, and where it was."""
