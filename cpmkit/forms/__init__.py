"""What the forms share: their contract, choice, options, costs, and warnings about a scene and its spacing."""
