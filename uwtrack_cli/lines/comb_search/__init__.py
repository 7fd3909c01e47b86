"""Combs before their lines: one fundamental that explains all of its teeth."""
