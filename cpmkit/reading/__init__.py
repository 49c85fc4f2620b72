"""What is read from a solution beside its values: integrals, gradients, fluxes."""
