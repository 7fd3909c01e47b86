"""General numerics on arrays: noise floor, filters, assignment, fits."""
