"""Several sheets of a surface in one band, with a separate unknown for each sheet at a node."""
