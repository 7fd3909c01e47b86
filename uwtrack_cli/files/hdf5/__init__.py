"""Products: HDF5 files of containers."""
