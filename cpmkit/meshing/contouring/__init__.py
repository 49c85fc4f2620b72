"""Manifolds known by closest points alone: surfaces by dual contouring without a sign, curves traced step by step."""
