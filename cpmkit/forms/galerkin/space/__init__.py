"""The function space: dof map, splines and their energy over the samples."""
