"""What a velocity carries along: its terms, what keeps them from oscillating, and what enters through boundaries."""
