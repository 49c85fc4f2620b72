"""Studies: one scene solved over and over, against a solution that is known, to see how errors and costs go.

A study file is a scene file with the tables [exact] and [sweep]. Its runs are recorded one line each, and the
records are made into tables and figures.
"""
