"""Surfaces that a small neural network holds: the points at which it is zero."""
