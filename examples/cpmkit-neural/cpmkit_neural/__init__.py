"""Surfaces that are the zero set of a small neural network."""
