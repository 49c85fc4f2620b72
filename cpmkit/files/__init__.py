"""Files found, read without trust and written whole."""
