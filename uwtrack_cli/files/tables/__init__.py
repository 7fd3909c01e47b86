"""Tables and settings: CSV, TOML and JSON."""
