"""Services for all packages: checked input, options, memory, threads, compiled kernels, progress, messages."""
