"""What speaks against a passage that was fitted: its own data, the sound, other parts of the band."""
