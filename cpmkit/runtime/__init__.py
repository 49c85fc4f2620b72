"""Services for all packages: checked input, options, memory, threads, compilation, progress, messages and old names."""
