"""Estimates of the error of a solution, and solving to a given error, in a given time or within a given memory."""
