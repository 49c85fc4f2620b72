"""The paper's closest point method: a scene laid out on a band (sheets, boundaries, ghosts), and its matrices."""
