"""Target motion from bearings and frequencies: model, modes, report."""
