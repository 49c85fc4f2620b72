"""The commands that make applications of scene files: fields of vectors, maps, and painted surfaces."""
