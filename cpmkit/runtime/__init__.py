"""What a process has: memory, threads, compiled kernels, arrays as they come in, progress and warnings."""
