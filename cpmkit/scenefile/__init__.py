"""Scene files: TOML, its schema, the kinds that it can name, the options of pictures, and the examples."""
