"""One mesh value: cells, edges, rims, winding, repair, subdivision, refinement and cuts along boundaries."""
