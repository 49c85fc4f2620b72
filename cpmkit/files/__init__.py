"""Files found, read without trust and written whole; the plain values (numbers, lists, tables) in them."""
