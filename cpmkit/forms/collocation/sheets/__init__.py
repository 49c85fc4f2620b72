"""Several sheets of a surface in one band: which unknown is on which."""
