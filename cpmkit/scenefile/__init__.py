"""Scene files: TOML, its schema, the kinds that it can name, and the examples."""
