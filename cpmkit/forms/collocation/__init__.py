"""The closest point method of King et al. (2024): the layout of a scene on a band, and its matrices."""
