"""One mesh value: cells, edges, rims, winding, repair, subdivision, quadrature and cuts along boundaries."""
