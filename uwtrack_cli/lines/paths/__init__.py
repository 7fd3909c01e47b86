"""Track-before-detect: paths through the spectrogram."""
