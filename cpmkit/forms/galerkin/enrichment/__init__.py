"""The singular functions that solutions have at the ends of boundaries, as unknowns beside the splines."""
