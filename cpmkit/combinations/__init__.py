"""Sources made of other sources, whatever their kind: unions, motions, solids, cuts and trimmed pieces."""
