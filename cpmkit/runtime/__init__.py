"""Services for all packages: checked input, options, memory, compilation, index sets, progress, messages, old names."""
