"""Parts of the closest-approach and position stages."""
