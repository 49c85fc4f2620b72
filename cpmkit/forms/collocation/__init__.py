"""The paper's closest point method, in the paper's order: sheets, boundary, ghosts, tables."""
