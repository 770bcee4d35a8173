"""What a run does: samples in blocks, evaluated for all analyses, counted and recorded."""
