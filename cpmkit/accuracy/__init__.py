"""How large the error of a solution is, and solving to an error, in a time, or within a memory that is asked for."""
