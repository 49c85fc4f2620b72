"""Scenes of the plane in which two features of the package meet, with exact solutions."""
