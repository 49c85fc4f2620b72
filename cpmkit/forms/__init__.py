"""Ways of discretising that the families of equations are written over."""
