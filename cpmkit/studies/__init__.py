"""Studies: one scene solved at several resolutions by several methods, and compared with a known solution."""
