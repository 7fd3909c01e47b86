"""The only floor that opens files: products, audio, tables, sensor files."""
