"""Services of the process: checked input, options, memory, threads, compiled kernels, progress, messages."""
