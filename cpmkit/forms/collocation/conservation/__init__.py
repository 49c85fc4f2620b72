"""What is free, what leaks, and how it is put right."""
