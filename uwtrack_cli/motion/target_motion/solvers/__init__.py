"""Optimisers of the target motion problem, the published ones among them."""
