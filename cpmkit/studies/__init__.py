"""Studies: one scene solved at several resolutions by several methods, and compared with a known solution.

A study file is a scene file with the tables [exact] and [sweep]. Each run is recorded in one line; tables and figures
are made from the records.
"""
