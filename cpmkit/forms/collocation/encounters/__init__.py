"""Where boundaries, rims and branches come so near to each other that values run together."""
