"""Sound to spectrogram, levels, overview and peaks."""
