"""The closest approach in one recording: model, fit and report."""
