"""Solutions of any form: read, integrated, summed up."""
