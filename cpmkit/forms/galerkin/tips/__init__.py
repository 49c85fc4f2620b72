"""What u is like where a boundary ends inside a surface, as one more unknown a tip beside the splines."""
