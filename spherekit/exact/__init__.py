"""Reference values: configurations and rates in more digits than float64 has."""
