"""The fit of a passage: start, likelihood, noise, covariance, and whether it is one."""
