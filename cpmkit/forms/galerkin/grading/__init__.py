"""Where splines are finer, and a mesh whose cells and samples follow."""
