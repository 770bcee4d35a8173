"""Figures for paper and screen, drawn by matplotlib from the scenes of a run."""
