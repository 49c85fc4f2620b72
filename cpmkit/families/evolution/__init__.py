"""Equations in time: schedule of the steps, time stepping schemes, runs and checkpoints."""
