"""One script for every constant that was fitted: `python -m studies.constants.NAME`."""
