"""How the nodes of a band see boundaries and edges."""
