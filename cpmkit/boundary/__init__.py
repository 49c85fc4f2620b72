"""The conditions' side of the method: which side of a boundary a point is on, ghosts, and the rim of open surfaces."""
