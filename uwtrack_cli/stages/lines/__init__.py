"""Parts of the line stages: association, logics, policies, families, paths."""
