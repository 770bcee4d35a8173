"""Forces and motion: inverse and forward dynamics, reactions, reduced models."""
