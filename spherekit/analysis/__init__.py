"""The contract of analyses, their discovery, and running them."""
