"""What the spacing does not resolve, told or refused."""
