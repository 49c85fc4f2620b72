"""Problems in time: schedule, schemes, steps, checkpoints."""
