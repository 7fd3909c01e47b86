"""Target motion from bearings and Doppler: model, solvers, modes, regions."""
