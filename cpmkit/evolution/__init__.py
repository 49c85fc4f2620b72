"""Problems in time: equations, schemes, steps, frames and checkpoints."""
