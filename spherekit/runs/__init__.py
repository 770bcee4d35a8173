"""The contract of analyses, and runs of them: samples, results, speed and accuracy."""
